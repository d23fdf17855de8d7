"""Angles as people and files count them, and those of the DH table.

`zero`: 'dh' counts as the table does (theta2 = 0: upper arm horizontal); 'vertical' as the source's XML and pendants do
(J2 = 0: upper arm upright, positive forwards; theta2 = 90 degrees - J2).
`coupled`: the third angle is that of the forearm against the base, as pendants of arms with coupled drives show it
(S3, table 3.1: theta2 + theta3), not that against the upper arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm import QUARTER

ZEROS = ('dh', 'vertical')


@dataclass(frozen=True)
class Counting:
    """How joint angles are counted. ValueError for an unknown zero."""

    zero: str = 'dh'
    coupled: bool = False

    def __post_init__(self) -> None:
        if self.zero not in ZEROS:
            raise ValueError(f"zero '{self.zero}': known are {', '.join(ZEROS)}")

    def to_dh(self, angles: np.ndarray) -> np.ndarray:
        """(..., 6) DH angles, rad."""
        theta = np.array(angles, float)
        upright = self.zero == 'vertical'
        if upright:
            theta[..., 1] = QUARTER - theta[..., 1]
        if self.coupled:  # from the forearm against the base to the forearm against the upper arm
            theta[..., 2] += (QUARTER if upright else 0.0) - theta[..., 1]
        return theta

    def from_dh(self, theta: np.ndarray) -> np.ndarray:
        """(..., 6) angles as counted here, rad."""
        angles = np.array(theta, float)
        upright = self.zero == 'vertical'
        if self.coupled:
            angles[..., 2] += angles[..., 1] - (QUARTER if upright else 0.0)
        if upright:
            angles[..., 1] = QUARTER - angles[..., 1]
        return angles


DH = Counting()
