"""Arcs of G2 and G3: their centre, exact points, and chords within a tolerance. Lengths in one unit, here m."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_process.segment import Point

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}  # first, second and normal axis
CENTRE_LETTERS = 'IJK'
# m; ends of an arc whose radii differ by more are no arc ...
MISMATCH = 5e-6
MISMATCH_SHARE = 1e-3  # ... and by more than this share of the radius
WORST_MISMATCH = 0.5e-3  # m, whatever the radius
MIN_RADIUS, MAX_RADIUS = 1e-6, 100.0  # m, radius
SAME = 1e-9  # m; ends that are one point make a whole turn


class ArcError(ValueError):
    """Numbers that no arc has."""


@dataclass(frozen=True)
class Arc:
    """From start to end around `centre`, at equal shares of angle, radius and height: a helix when the ends differ
    along the normal. sweep: rad, positive counter-clockwise seen from the end of the normal axis."""

    plane: int  # 17, 18 or 19
    start: Point
    end: Point
    centre: tuple[float, float]  # along first and second axis of the plane
    sweep: float

    @property
    def radii(self) -> tuple[float, float]:
        """At start and end."""
        p, q, _ = PLANES[self.plane]
        r0, r1 = (
            math.hypot(e[p] - self.centre[0], e[q] - self.centre[1]) for e in (self.start, self.end)
        )
        return r0, r1

    @property
    def length(self) -> float:
        """Along the path."""
        rise = self.end[PLANES[self.plane][2]] - self.start[PLANES[self.plane][2]]
        return math.hypot(abs(self.sweep) * sum(self.radii) / 2, rise)

    def at(self, share: np.ndarray) -> np.ndarray:
        """(n, 3) points at shares (n,) of the arc, 0 to 1."""
        p, q, r = PLANES[self.plane]
        r0, r1 = self.radii
        a0 = math.atan2(self.start[q] - self.centre[1], self.start[p] - self.centre[0])
        angle, radius = a0 + share * self.sweep, r0 + share * (r1 - r0)
        out = np.empty((len(share), 3))
        out[:, p] = self.centre[0] + radius * np.cos(angle)
        out[:, q] = self.centre[1] + radius * np.sin(angle)
        out[:, r] = self.start[r] + share * (self.end[r] - self.start[r])
        return out

    def moved(self, by: Point) -> Arc:
        """The same arc elsewhere."""
        p, q, _ = PLANES[self.plane]
        start, end = ((e[0] + by[0], e[1] + by[1], e[2] + by[2]) for e in (self.start, self.end))
        centre = (self.centre[0] + by[p], self.centre[1] + by[q])
        return Arc(self.plane, start, end, centre, self.sweep)

    def count(self, tolerance: float) -> int:
        """Chords whose middles lie within `tolerance` of the arc."""
        radius = max(self.radii)
        step = 2 * math.acos(max(-0.5, 1 - tolerance / radius)) if radius > 0 else math.pi
        return max(2, math.ceil(abs(self.sweep) / step))

    def chords(self, tolerance: float) -> np.ndarray:
        """(n + 1, 3) corners on the arc, first and last are start and end themselves."""
        corners = self.at(np.linspace(0.0, 1.0, self.count(tolerance) + 1))
        corners[0], corners[-1] = self.start, self.end
        return corners


def by_centre(
    plane: int, start: Point, end: Point, centre: tuple[float, float], left: bool, turns: int = 1
) -> Arc:
    """left: counter-clockwise (G3). Ends in one point make `turns` whole turns. Raises ArcError."""
    p, q, _ = PLANES[plane]
    arc = Arc(plane, start, end, centre, _sweep(plane, start, end, centre, left, turns))
    r0, r1 = arc.radii
    if not MIN_RADIUS <= r0 <= MAX_RADIUS:
        raise ArcError(f'the radius is {r0 * 1e3:.6g} mm')
    off = abs(r1 - r0)
    if off > WORST_MISMATCH or off > max(MISMATCH, MISMATCH_SHARE * r0):
        raise ArcError(
            f'radius mismatch: {r0 * 1e3:.4f} mm at the start, {r1 * 1e3:.4f} at the end'
        )
    return arc


def _sweep(
    plane: int, start: Point, end: Point, centre: tuple[float, float], left: bool, turns: int
) -> float:
    p, q, _ = PLANES[plane]
    a0, a1 = (math.atan2(e[q] - centre[1], e[p] - centre[0]) for e in (start, end))
    once = (a1 - a0) % (2 * math.pi) if left else (a0 - a1) % (2 * math.pi)
    if math.hypot(end[p] - start[p], end[q] - start[q]) <= SAME or once == 0.0:
        once = 2 * math.pi
    once += 2 * math.pi * (turns - 1)
    return once if left else -once


def by_radius(
    plane: int, start: Point, end: Point, radius: float, left: bool, turns: int = 1
) -> Arc:
    """The shorter arc of that radius, with a negative one the longer. Raises ArcError."""
    p, q, _ = PLANES[plane]
    along = (end[p] - start[p], end[q] - start[q])
    chord, size = math.hypot(*along), abs(radius)
    if chord <= SAME:
        raise ArcError('an arc by its radius needs an end other than its start')
    if chord / 2 > size + MIN_RADIUS:
        raise ArcError(
            f'radius mismatch: the ends are {chord * 1e3:.4f} mm apart, {size * 2e3:.4f} mm is the diameter'
        )
    aside = math.sqrt(max(0.0, size**2 - chord**2 / 4))
    side = aside if left == (radius > 0) else -aside
    centre = (
        (start[p] + end[p]) / 2 - side * along[1] / chord,
        (start[q] + end[q]) / 2 + side * along[0] / chord,
    )
    return by_centre(plane, start, end, centre, left, turns)
