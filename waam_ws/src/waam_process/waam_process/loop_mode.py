"""How a job closes the loop; the one place for these names."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any


class LoopMode(StrEnum):
    """In messages, on the command line and in job files this is the `loop_mode` of a job."""

    OPEN_LOOP = 'open_loop'  # the plan of the first scan is laid without corrections
    MONITOR = 'monitor'  # corrections are computed and published, not applied
    CLOSED_LOOP = 'closed_loop'  # corrections are applied, the torch follows the measured surface


LOOP_MODES = tuple(str(mode) for mode in LoopMode)
OLD_FIELD = 'profile'  # what `loop_mode` was called in files and messages of 0.2.0 and before


def with_loop_mode(fields: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of fields of a file or of a recorded message, in which the loop mode may have its old name.

    Everything that reads such fields by name calls this first.
    """
    known = dict(fields)
    if OLD_FIELD in known:
        before = known.pop(OLD_FIELD)
        known.setdefault('loop_mode', before)
    return known
