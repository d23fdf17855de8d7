"""How a job closes the loop; the one place for these names."""

from __future__ import annotations

from enum import StrEnum


class LoopMode(StrEnum):
    """In messages, on the command line and in job files this is called the profile of a job."""

    OPEN_LOOP = 'open_loop'  # the plan of the first scan is laid without corrections
    MONITOR = 'monitor'  # corrections are computed and published, not applied
    CLOSED_LOOP = 'closed_loop'  # corrections are applied, the torch follows the measured surface


LOOP_MODES = tuple(str(mode) for mode in LoopMode)
