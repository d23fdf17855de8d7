"""How fast simulated time may run while the job computes.

At ten times real time, a second in which a layer is planned or corrected would cost ten seconds of machine time, and
the part would cool for ten. So while the machine stands and the job computes, time runs no faster than the wall clock.
"""

from __future__ import annotations

import numpy as np

ARC = 1  # bit of the controller's outputs
STILL = 1e-8  # m in a step
MAX_WAIT = 10.0  # s of the wall clock: a job that computes for longer waits for something


class Pace:
    """Of one cell, told of every step."""

    def __init__(self) -> None:
        self._began: tuple[float, int] | None = None  # of the standstill: s of the wall clock, us

    def ahead(self, samples: np.ndarray, time_us: int, now: float, computes: bool) -> float:
        """s that the next step is to wait. samples: of `plant_port.SAMPLE`, of the step that ended at `time_us` of
        controller time; now: s, steady clock; computes: whether the job does."""
        if not computes or _works(samples[0], samples[-1]):
            self._began = None
            return 0.0
        if self._began is None:
            self._began = now, time_us
        began, began_us = self._began
        passed = now - began
        return max(1e-6 * (time_us - began_us) - passed, 0.0) if passed < MAX_WAIT else 0.0


def _works(first: np.void, last: np.void) -> bool:
    """Whether the machine moves between two samples, or its arc is on."""
    moved = max(abs(last[axis] - first[axis]) for axis in ('table_x', 'table_y', 'tool_z'))
    return bool(moved > STILL or last['outputs'] & ARC)
