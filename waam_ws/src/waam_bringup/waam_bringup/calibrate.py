"""`waam calibrate`: the graph behind it. Shakes an axis, listens to it, tells the controller settings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from . import paths
from .cli_common import add_run, run_and_domain

if TYPE_CHECKING:  # ROS and numpy are loaded only when a verb runs
    import numpy as np

    from waam_calibrate.commission_beads import ArcRecord
    from waam_calibrate.graph import Settings
    from waam_calibrate.lead import WireRecord
    from waam_calibrate.resonance import Samples
    from waam_calibrate.sweep import Sweep
    from waam_process.segment import Point


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb, with this graph."""
    from waam_calibrate import cli
    from waam_calibrate.graph import Graph

    cli.register(commands, Graph(paths.calibrations_dir, add_run, measure, send, told, wire))


def check_axis(axis: str | None) -> None:
    """ValueError for x where a chuck stands in its place: no gauge measures its mm, and nothing shakes."""
    from waam_process.cell_keys import CHUCK

    from .cell_check import find

    cell = find(paths.cell_name()) if axis == 'x' else None
    if cell and CHUCK in cell.values:
        raise ValueError(
            f'{cell.where(CHUCK)}: the X axis is a chuck, its steps follow from it and from the diameter of each shaft'
        )


def measure(args: argparse.Namespace, sweep: Sweep, axis: str, point: Point | None) -> Samples:
    """Samples of a sweep on the graph that is up. ClientError when something does not answer or refuses."""
    from .operate import require_up
    from .shaking import shake

    check_axis(axis)
    run, domain = run_and_domain(args)
    state = require_up(run)
    return shake(domain, sweep, axis, point, state.simulated and 'cell' in state.nodes)


def send(args: argparse.Namespace, settings: Settings) -> str:
    """Tells the controller; returns what it said to the last setting. ClientError when it refuses one."""
    from .operate import require_up
    from .shaking import Shaking

    run, domain = run_and_domain(args)
    require_up(run)
    with Shaking(domain) as graph:
        return graph.configure(settings)


def told(args: argparse.Namespace) -> dict[str, float] | None:
    """Settings that the controller has; None when no graph with one is up. ValueError, see `check_axis`."""
    from .client import ClientError
    from .operate import require_up
    from .shaking import Shaking

    check_axis(getattr(args, 'axis', None))
    try:
        run, domain = run_and_domain(args)
        require_up(run)
        with Shaking(domain) as graph:
            return graph.told()
    except ClientError:
        return None


def wire(path: Path) -> WireRecord:
    """Wire speed in the telemetry of a job folder, a recording or one .mcap file. EvidenceError when there is none."""
    from waam_calibrate.lead import WireRecord

    rows = _telemetry(path)
    return WireRecord(
        rows['controller_us'] * 1e-6, rows['wire_feed_commanded'], rows['wire_feed_speed'],
        rows['arc_established'].astype(bool),
    )  # fmt: skip


def arc(path: Path) -> ArcRecord:
    """The arc of the same. EvidenceError."""
    from waam_calibrate.commission_beads import ArcRecord

    rows = _telemetry(path)
    enabled, lit = (rows[n].astype(bool) for n in ('arc_enabled', 'arc_established'))
    return ArcRecord(
        rows['controller_us'] * 1e-6, enabled, lit, rows['arc_current'], rows['arc_voltage'], rows['wire_feed_speed'],
        rows['wire_feed_commanded'],
    )  # fmt: skip


def _telemetry(path: Path) -> np.ndarray:
    """Frames of the last start of the controller, each once, in order."""
    import numpy as np

    from waam_calibrate.evidence import EvidenceError
    from waam_node import cdr
    from waam_record.bag_reader import messages_of
    from waam_record.bag_writer import BagError
    from waam_record.read_record import ReplayError, record_folder

    try:
        frames = messages_of(path if path.is_file() else record_folder(path), 'telemetry')
        _, rows = cdr.read_frames(frames)
    except (BagError, ReplayError) as e:  # names the path itself
        raise EvidenceError(str(e)) from None
    except (OSError, ValueError) as e:
        raise EvidenceError(f'{path}: {e}') from None
    if not frames:
        raise EvidenceError(f'{path}: no telemetry is recorded there')
    rows = rows[rows['boot_id'] == rows['boot_id'][-1]]
    _, first = np.unique(rows['controller_us'], return_index=True)
    return rows[first]


def check(args: argparse.Namespace, folder: Path | None = None) -> list[str]:
    """Why no job may run, one reason each (waam calibrate status). args: that name the graph."""
    from waam_calibrate import results, store

    kept = store.load_all(folder or paths.calibrations_dir())
    asks = any(r.kind == 'steps' and r.settings for r in results.newest(kept.results).values())
    return results.refusals(kept.results, kept.damaged, told(args) if asks else None)
