"""Idle moves with continuous acceleration: the harmonic law of source 004.

Equations (1)-(3) of S4, see docs/equations.md.

The law joins two places with R'' = A cos(k t + psi), R' = (A / k)(sin(k t + psi) - sin psi) + C. The torch stands still
where the arc goes off and where it is lit, so speed and acceleration vanish at both ends; then psi = -pi/2,
k = 2 pi / T, C = 0 and A = 2 pi L / T^2, and no iteration is needed: R = L (u - sin(2 pi u) / (2 pi)), u = t / T.

The controller is told pieces of one speed each and goes from one to the next with the acceleration of its axes, so its
motion has the law's acceleration on average over a piece only. More pieces follow the law more closely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

FINEST = 0.2e-3  # m: pieces of a move are no shorter than this on average
END = 2e-6  # m: the least length of a piece at either end
PIECES = 72  # of equal time, at most: with 50 the steps of the speed still show in the jerk


@dataclass(frozen=True)
class HarmonicLaw:
    """From rest to rest over `length` (m) in `duration` (s)."""

    length: float
    duration: float

    @classmethod
    def within(cls, length: float, speed: float, acceleration: float) -> HarmonicLaw:
        """The quickest one within a highest speed (m/s) and acceleration (m/s2)."""
        by_speed = 2 * length / speed
        by_acceleration = math.sqrt(2 * math.pi * length / acceleration)
        return cls(length, max(by_speed, by_acceleration))

    def position(self, t: float | np.ndarray) -> np.ndarray:
        """m after t seconds."""
        u = np.asarray(t, float) / self.duration
        return self.length * (u - np.sin(2 * np.pi * u) / (2 * np.pi))

    def speed(self, t: float | np.ndarray) -> np.ndarray:
        """m/s after t seconds; zero at both ends."""
        u = np.asarray(t, float) / self.duration
        return self.length / self.duration * (1 - np.cos(2 * np.pi * u))

    def acceleration(self, t: float | np.ndarray) -> np.ndarray:
        """m/s2 after t seconds; zero at both ends, so it does not break where moves meet."""
        u = np.asarray(t, float) / self.duration
        return 2 * np.pi * self.length / self.duration**2 * np.sin(2 * np.pi * u)

    def pieces(self, most: int = PIECES) -> tuple[np.ndarray, np.ndarray]:
        """Places (n + 1,) m and mean speeds (n,) m/s of pieces of equal time, n at most `most`. Those at the ends are
        joined until they are as long as END, for the coordinates of a program are rounded to micrometres."""
        n = int(
            np.clip(round(self.length / FINEST, 3), 1, most)
        )  # equal legs have equal pieces in every layer
        t = np.linspace(0, self.duration, n + 1)
        at = self.position(t)
        kept = (at >= at[0] + END) & (at <= at[-1] - END)
        kept[[0, -1]] = True
        return at[kept], np.diff(at[kept]) / np.diff(t[kept])
