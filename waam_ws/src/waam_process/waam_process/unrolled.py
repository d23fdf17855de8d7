"""A shaft as the plate that it is when it is unrolled: the one place that knows how the two belong together.

Work frame of a shaft: x = OVERLAP + R * angle around the shaft, y along its axis, z = radius - nominal radius + level.
R is the radius at which one turn is a whole number of STEP, so that every grid repeats after one turn to the cell. The
plate shows the turn and OVERLAP more at both ends: what lies there is the same metal once more (a period apart), so
that filters, beads and scans go over the seam as over any other place. It is half a radius thick, which holds as much
metal as the shaft (pi r^2 l over 2 pi r l).

Metal of dA = dx dy on the plate is dA * share(z) on the shaft, with share = radius / R. Frame of the part: its axis is
Y, up is Z, angle 0 is up, and X = r sin(angle), Z = r cos(angle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .grid import GridSpec, HeightGrid

STEP = 4e-3  # m, a whole number of the cells of maps, of metal and of heat
LONGEST_AXIS = 3.5  # m, of the controller: a chuck has no end, but its x has
OVERLAP = 20e-3  # m of the turn that are shown again at both ends: more than the reach of pool, bead and filters
# what people are told of a map
UNROLLED = (
    f'unrolled: x goes around it (one turn from {OVERLAP * 1e3:g} mm on), y is along its axis'
)
THINNEST = 30e-3  # m, diameter below which the two overlaps would meet


class ShaftError(ValueError):
    """A shaft, or a map of one, that cannot be unrolled; the text says what is wrong."""


@dataclass(frozen=True)
class Unrolled:
    """A shaft of a nominal `diameter` (m)."""

    diameter: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.diameter) and self.diameter >= THINNEST):
            raise ShaftError(
                f'the shaft has a diameter of {self.diameter * 1e3:g} mm, must be at least {THINNEST * 1e3:g} mm'
            )

    @property
    def radius(self) -> float:
        """Nominal, m."""
        return 0.5 * self.diameter

    @property
    def period(self) -> float:
        """m along x of one turn: a whole number of STEP."""
        return STEP * round(math.pi * self.diameter / STEP)

    @property
    def scale(self) -> float:
        """m along x of one radian: the radius at which x is as long as the surface."""
        return self.period / (2.0 * math.pi)

    @property
    def level(self) -> float:
        """z of the nominal surface, m: the thickness of the plate."""
        return 0.5 * self.radius

    @property
    def length_x(self) -> float:
        """m along x of the whole plate, from 0."""
        return self.period + 2.0 * OVERLAP

    def angle(self, x: ArrayLike) -> np.ndarray:
        """rad, of places x (m), any number of turns."""
        return (np.asarray(x, float) - OVERLAP) / self.scale

    def degrees(self, x: ArrayLike) -> np.ndarray:
        """Of a turning axis in degrees, of places x (m)."""
        return np.degrees(self.angle(x))

    def x_of(self, degrees: ArrayLike) -> np.ndarray:
        """m, of a turning axis in degrees."""
        return OVERLAP + self.scale * np.radians(np.asarray(degrees, float))

    def radius_at(self, z: ArrayLike) -> np.ndarray:
        """m, of heights z (m) of the plate."""
        return np.asarray(z, float) - self.level + self.radius

    def share(self, z: ArrayLike) -> np.ndarray:
        """Area on the shaft over area on the plate at heights z (m), and so surface speed over speed along x."""
        return self.radius_at(z) / self.scale

    def points(self, unrolled: np.ndarray) -> np.ndarray:
        """(n, 3) m in the frame of the part, of points (n, 3) of the work frame."""
        x, y, z = np.asarray(unrolled, float).T
        angle, r = self.angle(x), self.radius_at(z)
        return np.column_stack([r * np.sin(angle), y, r * np.cos(angle)])

    def unroll(self, points: np.ndarray) -> np.ndarray:
        """(n, 3) m in the work frame within the first turn, of points (n, 3) of the part."""
        x, y, z = np.asarray(points, float).T
        at = OVERLAP + self.scale * (np.arctan2(x, z) % (2.0 * math.pi))
        return np.column_stack([at, y, np.hypot(x, z) - self.radius + self.level])

    def folded(self, x: ArrayLike) -> np.ndarray:
        """The same places in the first turn, OVERLAP <= x < OVERLAP + period (m)."""
        return OVERLAP + (np.asarray(x, float) - OVERLAP) % self.period

    def first_turn(self, spec: GridSpec) -> np.ndarray:
        """bool (cols,): columns of a grid in the first turn, each place of the shaft once."""
        return (spec.x >= OVERLAP) & (spec.x < OVERLAP + self.period)

    def wrapped(self, turn: HeightGrid, spec: GridSpec) -> HeightGrid:
        """One turn on the columns of `spec`, as often as they come round. turn: map whose columns are exactly one turn,
        its first one at OVERLAP; both have the same cell and rows. ShaftError where they do not fit."""
        cell = spec.resolution
        count = round(self.period / cell)
        steps = (spec.origin_x - turn.spec.origin_x) / cell
        same = abs(turn.spec.resolution - cell) < 1e-9 and turn.spec.rows == spec.rows
        if not same or turn.spec.cols != count or abs(steps - round(steps)) > 1e-6:
            raise ShaftError(f'{turn.spec} is not one turn of {spec}')
        return HeightGrid(spec, turn.z[:, (np.arange(spec.cols) + round(steps)) % count])
