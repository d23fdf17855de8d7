"""Small errors of every axis, six of the arm and two of the positioner: a stated model.

Each stands off its true angle by a constant (`offset`) and two waves of its gear (`wave`; one and `waves` periods per
turn, phases at random). The positioner's turn axis lies off by `axis_offset` along x and y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm import AXES


@dataclass(frozen=True)
class AxisErrors:
    """offset, wave: standard deviations, rad; waves: periods per turn of the second wave; axis_offset: m."""

    offset: float = np.radians(0.02)
    wave: float = np.radians(0.005)
    waves: int = 8
    axis_offset: float = 0.05e-3

    def draw(self, seed: int, axes: int = AXES + 2) -> DrawnErrors:
        """One machine."""
        rng = np.random.default_rng(seed)
        return DrawnErrors(
            rng.normal(0, self.offset, axes),
            rng.normal(0, self.wave, (2, axes)),
            rng.uniform(0, 2 * np.pi, (2, axes)),
            self.waves,
            rng.normal(0, self.axis_offset, 2),
        )


@dataclass(frozen=True)
class DrawnErrors:
    """Of one machine: offset (8,), wave and phase (2, 8), axis (2,)."""

    offset: np.ndarray
    wave: np.ndarray
    phase: np.ndarray
    waves: int
    axis: np.ndarray

    def of(self, angles: np.ndarray) -> np.ndarray:
        """(N, 8): error of every axis at angles (N, 8), rad."""
        slow = self.wave[0] * np.sin(angles + self.phase[0])
        fast = self.wave[1] * np.sin(self.waves * angles + self.phase[1])
        return self.offset + slow + fast
