"""The tilt (B) and turn (C) positioner of source 003: table 2.1 and S3 eqs 2.5 to 2.7, printed errors corrected.

The part stands on the faceplate; its frame turns with C. Lengths in m, angles in rad. Poses are those of the tool, with
z pointing out of the part (the torch's axis, towards its body).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .arm import M20IB25, Arm, Link, step
from .frames import inverse, rotation

QUARTER = np.pi / 2


@dataclass(frozen=True)
class Positioner:
    """Table 2.1: a_b, d_bb, d_b: from the robot's frame to the tilt axis along x, y, z; d_c: from the tilt axis up
    to the faceplate. turn_zero: how far the faceplate is turned back at C = 0; a quarter turn makes C = 270 degrees +
    the azimuth of a point, as in table 2.2, the turn that brings this point to the +x side, where B tilts outwards.
    low, high: limits of B and C; speed: of both, rad/s.
    """

    a_b: float = 0.0
    d_bb: float = 0.0
    d_b: float = 0.0
    d_c: float = 0.0
    turn_zero: float = QUARTER
    low: tuple[float, float] = (-2.1, -1e9)
    high: tuple[float, float] = (2.1, 1e9)
    speed: tuple[float, float] = (np.radians(120.0), np.radians(190.0))

    def faceplate(self, b: np.ndarray | float) -> np.ndarray:
        """(..., 4, 4): robot's frame from the faceplate's, tilted by B, not turned. Table 2.1 with theta = 0, B, 0."""
        base = step(Link(self.d_b, self.a_b, QUARTER), np.zeros(()))
        tilt = step(Link(self.d_bb, 0.0, -QUARTER), np.asarray(b, float))
        return base @ tilt @ step(Link(self.d_c), np.zeros(()))

    def turned(self, poses: np.ndarray, c: np.ndarray | float) -> np.ndarray:
        """S3 eq 2.6: poses of the part's frame when the part is turned by C, on the faceplate that stands still.

        The part turns by -C about its z; with the printed sign a point at azimuth phi goes to 2 phi instead of
        staying where the robot is, against table 2.2.
        """
        return rotation(2, -(np.asarray(c, float) + self.turn_zero)) @ poses

    def to_robot(
        self, poses: np.ndarray, b: np.ndarray | float, c: np.ndarray | float
    ) -> np.ndarray:
        """S3 eqs 2.6 and 2.7: where the robot has to hold the tool for poses (..., 4, 4) of the part's frame.

        S3 eq 2.7 is printed for B = 0, with the program's frame tilted along; here B is part of it.
        """
        return self.faceplate(b) @ self.turned(poses, c)

    def to_part(
        self, poses: np.ndarray, b: np.ndarray | float, c: np.ndarray | float
    ) -> np.ndarray:
        """The inverse of `to_robot`: what tool poses (..., 4, 4) of the robot's frame are on the part."""
        return inverse(self.to_robot(np.eye(4), b, c)) @ poses


@dataclass(frozen=True)
class Machine:
    """An arm and the positioner before it."""

    arm: Arm = M20IB25
    positioner: Positioner = field(default_factory=lambda: Positioner(a_b=1.2, d_b=0.35, d_c=0.15))
