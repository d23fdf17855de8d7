"""How the positioner turns a level part while the torch goes: the redundancy of six axes, tilt and turn in a job.

A torch on a level part leaves the turn C free. It is a linear function of where the torch is, start + along . (x, y)
from the middle of the box. So it is smooth, the same on every way to a place, and it serves beads, scans and idle moves
alike; nothing above the robot knows of it. `turn_choice.choose` chooses it so that the arm stays away from limits and
singularities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Turning:
    """start: rad at the middle of the box, beside where the positioner stands at rest; along: (2,) rad/m of x and y."""

    start: float = 0.0
    along: tuple[float, float] = (0.0, 0.0)

    @property
    def still(self) -> bool:
        """The part does not turn, and stands as at rest."""
        return not (self.start or any(self.along))

    def at(self, tips: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """(N,) rad for torch positions (N, 3), m, machine coordinates; middle: (3,) m of the box."""
        apart = np.asarray(tips, float)[:, :2] - middle[:2]
        return np.asarray(self.start + apart @ np.array(self.along))

    @property
    def text(self) -> str:
        """For people."""
        x, y = np.degrees(self.along) * 1e-3
        return f'{np.degrees(self.start):.0f} deg, and {x:.3f} deg per mm of x, {y:.3f} deg per mm of y'
