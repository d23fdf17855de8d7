"""Axes that are neither square nor to scale: programs are distorted the opposite way, so that the part is true.

A machine takes a commanded point c (mm, work frame) to the point A c, where the columns of A are its real axes. The
correction commands A^-1 p for a wanted point p (docs/equations.md, S2). The map is linear about the work zero.
`skew_program` applies it to G-code."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

MAX_SKEW = math.radians(10)


class SkewError(ValueError):
    """Calibration out of range, or a program that cannot be corrected; the text names value or line."""


@dataclass(frozen=True)
class AxisErrors:
    """What calibration found."""

    y_to_x: float = 0.0  # rad, the y axis leans towards +x (alpha of the source)
    x_to_y: float = 0.0  # rad, the x axis leans towards +y (beta)
    z_to_x: float = 0.0  # rad, the z axis leans towards +x
    z_to_y: float = 0.0  # rad, the z axis leans towards +y
    scale_x: float = 1.0  # real over commanded length
    scale_y: float = 1.0
    scale_z: float = 1.0

    def __post_init__(self) -> None:
        for name in ('y_to_x', 'x_to_y', 'z_to_x', 'z_to_y'):
            angle = getattr(self, name)
            if not abs(angle) <= MAX_SKEW:
                raise SkewError(
                    f'{name} is {math.degrees(angle):g} deg, at most 10 deg is a calibration'
                )
        for name in ('scale_x', 'scale_y', 'scale_z'):
            if not 0.9 <= getattr(self, name) <= 1.1:
                raise SkewError(f'{name} is {getattr(self, name):g}, must be 0.9 to 1.1')

    @property
    def axes(self) -> np.ndarray:
        """A (3, 3): columns are the real x, y and z axis per commanded unit."""
        lean = math.hypot(math.sin(self.z_to_x), math.sin(self.z_to_y))
        x = (math.cos(self.x_to_y), math.sin(self.x_to_y), 0.0)
        y = (math.sin(self.y_to_x), math.cos(self.y_to_x), 0.0)
        z = (math.sin(self.z_to_x), math.sin(self.z_to_y), math.sqrt(1.0 - lean**2))
        columns = (
            np.array(x) * self.scale_x,
            np.array(y) * self.scale_y,
            np.array(z) * self.scale_z,
        )
        return np.stack(columns, axis=1)

    @property
    def correction(self) -> np.ndarray:
        """(3, 3) matrix from wanted to commanded points: A^-1."""
        return np.linalg.inv(self.axes)


def angles_from_diagonals(side_x: float, side_y: float, rising: float, falling: float) -> float:
    """y_to_x (rad) from a measured parallelogram: its sides and both diagonals (any one unit of length).

    rising: from the corner at the origin to the opposite one. By the law of cosines, rising^2 - falling^2 =
    4 * side_x * side_y * cos(angle between the sides). SkewError when no parallelogram has these measures.
    """
    if min(side_x, side_y, rising, falling) <= 0:
        raise SkewError('sides and diagonals must be above 0')
    sine = (rising**2 - falling**2) / (4 * side_x * side_y)
    closure = (rising**2 + falling**2) / (2 * (side_x**2 + side_y**2)) - 1
    if abs(sine) >= math.sin(MAX_SKEW) or abs(closure) > 5e-3:
        raise SkewError(
            f'no parallelogram of {side_x:g} x {side_y:g} has diagonals of {rising:g} and {falling:g}: measure again'
        )
    return math.asin(sine)
