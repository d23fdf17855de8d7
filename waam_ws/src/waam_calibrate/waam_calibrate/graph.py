"""What the verbs need of the graph; the command line gives it (waam_bringup.calibrate). Pure: types only."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the command line loads this at every call; numpy it does not need
    from waam_process.segment import Point

    from .lead import WireRecord
    from .resonance import Samples
    from .sweep import Sweep

Settings = list[tuple[str, float]]


@dataclass(frozen=True)
class Graph:
    """folder: of the results when none is given. add_options: those that name a graph. measure: shakes an axis at a
    place (m, work frame; None = where the torch is). send: settings of the controller; returns what it said last.
    told: the settings that it has, by name; None = no graph is up, or it has none.
    wire: telemetry of a recording (job folder, folder or file)."""

    folder: Callable[[], Path]
    add_options: Callable[[argparse.ArgumentParser], None]
    measure: Callable[[argparse.Namespace, Sweep, str, Point | None], Samples]
    send: Callable[[argparse.Namespace, Settings], str]
    told: Callable[[argparse.Namespace], dict[str, float] | None]
    wire: Callable[[Path], WireRecord]
