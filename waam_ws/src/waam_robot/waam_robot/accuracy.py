"""How far the wire tip misses its place on the part when every axis has small errors: a stated model.

Every axis, six of the arm and two of the positioner, stands off its true angle by a constant (`offset`) and by two
waves of its gear (`wave`; one and `waves` periods per turn, phases at random). The positioner's turn axis lies off by
`axis_offset` along x and y. `taught`: the program is taught at the first point of its path, as welders do; the miss
there is taken off, as a shift in the robot's frame. Without that the split gains next to nothing: the constant miss at
the place where the robot works stays, and turning the part does not take it away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm import AXES, Arm, forward
from .positioner import Positioner


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


def miss(
    arm: Arm,
    positioner: Positioner,
    theta: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    errors: DrawnErrors,
    taught: bool = True,
) -> np.ndarray:
    """(N, 3) m: where the wire tip is minus where it should be, in the part's frame.

    theta (N, 6), b, c (N,): what the program commands, rad.
    """
    axes = np.column_stack([theta, b, c])
    off = axes + errors.of(axes)
    meant = positioner.to_part(forward(arm, theta), b, c)[:, :3, 3]
    tip = forward(arm, off[:, :AXES])
    tip[:, :2, 3] -= errors.axis
    if taught and len(tip):
        first = positioner.to_robot(_at(meant[:1]), off[:1, 6], off[:1, 7])[0, :3, 3]
        tip[:, :3, 3] += first - tip[0, :3, 3]
    return positioner.to_part(tip, off[:, 6], off[:, 7])[:, :3, 3] - meant


def _at(points: np.ndarray) -> np.ndarray:
    """(N, 4, 4) upright poses at points (N, 3)."""
    out = np.broadcast_to(np.eye(4), (len(points), 4, 4)).copy()
    out[:, :3, 3] = points
    return out
