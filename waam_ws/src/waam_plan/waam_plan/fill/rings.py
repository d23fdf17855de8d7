"""Rings at equal distances inside a polygon: contours, and the spirals that join them without putting the arc out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LinearRing, LineString, Polygon
from shapely.geometry.base import BaseGeometry

from waam_plan.fill.contour import wall_width
from waam_plan.fill.medial import medial_lines
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import merged, pieces

STEP = 1.0e-3  # m, between points of a spiral
RAMP = 6.0  # length of the way from one ring of a spiral to the next, over their distance
FILLED = 0.40  # bead widths beside a line in which the overlap is in range
SLIVER = 0.1  # ring spacings: half the thickness of a sliver
CORE = 1.5  # ring spacings: a thicker band inside a ring has room for a bead in its middle
EVEN = 0.4  # of half its thickness: by so much the middle of a closed band may lie off
NARROW = 0.07  # bead widths: a gap of twice this between the bands closes by itself


@dataclass(frozen=True)
class Ring:
    """One inset of a polygon and the insets that lie in it."""

    polygon: Polygon
    inner: list[Ring]


def bead_count(width: float, bead_width: float, pitch_ratio: float) -> int:
    """Beads across a wall: n = ceil((S - W) / (delta W) + 1) (docs/equations.md, S3)."""
    return max(1, math.ceil((width - bead_width) / (pitch_ratio * bead_width) + 1 - 1e-6))


def spacing(polygon: Polygon, settings: PlanSettings, more: float = 0.0) -> float:
    """Distance of neighbouring rings (m): n beads from edge to edge where the polygon is widest.

    more: beads beyond the fewest that keep the pitch; the rest of a bead is room left in the middle.
    """
    between = wall_width(polygon) - 2 * settings.first_ring
    n = bead_count(between + settings.bead_width, settings.bead_width, settings.pitch_ratio) + more
    return between / (n - 1) if n > 1 and between > 0 else settings.pitch


def nested(polygon: Polygon, first: float, step: float) -> list[Ring]:
    """Insets at first, first + step, ... (m) as trees with the outer ones at the root.

    Slivers, whose two sides would lie on each other, are left out: they are the place of one line.
    """
    found = [p for p in pieces(polygon.buffer(-first)) if not p.buffer(-SLIVER * step).is_empty]
    return [Ring(p, nested(p, step, step)) for p in found]


def contour_lines(polygon: Polygon, settings: PlanSettings, more: float = 0.0) -> list[np.ndarray]:
    """Closed lines from the edge inwards, the first `first_ring` inside, and lines in the middle of what they leave.

    more: see `spacing`.
    """
    step = spacing(polygon, settings, more)
    found = nested(polygon, settings.first_ring, step)
    radius = settings.corner_radius * settings.bead_width
    lines = [x for ring in found for x in _closed(ring, radius) if _worth(x, settings)]
    return lines + [x for ring in found for x in _cores(ring, step, settings)]


def _cores(ring: Ring, step: float, settings: PlanSettings) -> list[np.ndarray]:
    """Middle lines of the bands inside a ring that no inner ring follows and that have room for a bead.

    A closed band of uneven thickness has none: its room comes and goes, and `gap_lines` finds the places.
    """
    left: BaseGeometry = ring.polygon
    if ring.inner:
        left = left.difference(merged([r.polygon for r in ring.inner]).buffer(1.02 * step))
    own: list[np.ndarray] = []
    for band in pieces(left):
        room = band.buffer(-0.5 * CORE * step)
        if room.is_empty:
            continue
        if band.interiors:
            own += _closed_middle(band)
        else:  # where it narrows, a middle line would run on the rings beside it
            wide = room.buffer(0.5 * CORE * step).intersection(band)
            for place in pieces(wide):
                own += medial_lines(place, settings.bead_width / 3)
    return own + [x for r in ring.inner for x in _cores(r, step, settings)]


def _worth(line: np.ndarray, settings: PlanSettings) -> bool:
    """False for rings shorter than two bead widths: they are dots, and a line through the gap is better."""
    return LineString(line).length > 2 * settings.bead_width


def rounded(polygon: Polygon, radius: float) -> Polygon:
    """Corners with a radius (m): at a sharp one the bead overlaps itself inside and leaves a hollow outside."""
    if radius <= 0:
        return polygon
    smooth = polygon.buffer(-radius).buffer(2 * radius).buffer(-radius)
    return smooth if isinstance(smooth, Polygon) and not smooth.is_empty else polygon


def _closed(ring: Ring, radius: float) -> list[np.ndarray]:
    polygon = rounded(ring.polygon, radius)
    own = [np.asarray(r.coords) for r in (polygon.exterior, *polygon.interiors)]
    return own + [line for inner in ring.inner for line in _closed(inner, radius)]


def spiral_lines(
    polygon: Polygon, settings: PlanSettings, shift: float, more: float = 0.0
) -> list[np.ndarray]:
    """One spiral for every nest of rings that lie simply in each other; rings around holes stay rings.

    shift: where on the outer ring a spiral begins, share of its length. more: see `spacing`.
    """
    out: list[np.ndarray] = []
    roots = nested(polygon, settings.first_ring, spacing(polygon, settings, more))
    while roots:
        ring = roots.pop(0)
        nest = [ring]
        while len(nest[-1].inner) == 1 and not _holes(nest[-1]) and not _holes(nest[-1].inner[0]):
            nest.append(nest[-1].inner[0])
        rings = [r.polygon.exterior for r in nest]
        rings = [r for r in rings if _worth(np.asarray(r.coords), settings)]
        out += [_spiral(rings, shift)] if rings else []
        out += [np.asarray(hole.coords) for r in nest for hole in r.polygon.interiors]
        roots = nest[-1].inner + roots
    return out


def _holes(ring: Ring) -> bool:
    return bool(ring.polygon.interiors)


def _spiral(rings: list, shift: float) -> np.ndarray:
    """Once round each ring, from the outer one inwards; a ramp of RAMP ring distances leads to the next one.

    All ramps lie side by side, so turns keep their distance on them as well; it is less only where the first leaves the
    outer ring and the last reaches the inner one. Never leaves the rings.
    """
    inside = Polygon(rings[0]).buffer(1e-9)
    turn = begun_at(np.asarray(rings[0].coords), shift * rings[0].length)
    out, ramp = [turn], turn[:1]
    for inner in rings[1:]:
        begin = LineString(inner.coords).project(shapely.Point(turn[0]))
        before, turn = LineString(turn), begun_at(np.asarray(inner.coords), begin)
        points = shapely.get_coordinates(shapely.segmentize(LineString(turn), STEP))
        along = np.append(0, np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum())
        length = max(min(RAMP * before.distance(shapely.Point(turn[0])), along[-1]), STEP)
        share = np.clip(along / length, 0, 1)[:, None]
        share = share**2 * (3 - 2 * share)
        ways = (
            (1 - share) * near + share * points
            for near in (_evenly(before, points[along <= length], along), _nearest(before, points))
        )
        way = next((w for w in ways if inside.covers(LineString(w))), None)
        out.append(way if way is not None else points)
        ramp = points[along <= length]
    return np.concatenate([*out, ramp] if len(rings) > 1 else out)


def _nearest(before: LineString, points: np.ndarray) -> np.ndarray:
    """(n, 2) points of the ring `before` nearest to points (n, 2) m; they jump and turn back at corners."""
    near = shapely.line_locate_point(before, shapely.points(points))
    return shapely.get_coordinates(shapely.line_interpolate_point(before, near))


def _evenly(before: LineString, ramp: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(n, 2) points of the ring `before` for places `along` (n,) m, beside a ramp (k, 2) m that begins where it does.

    The way on the ring goes evenly with the way on the ramp, so the torch never turns back.
    """
    far = before.project(shapely.Point(ramp[-1])) if len(ramp) > 1 else 0.0
    pace = far / max(along[len(ramp) - 1], STEP)
    return shapely.get_coordinates(shapely.line_interpolate_point(before, pace * along))


def begun_at(ring: np.ndarray, distance: float) -> np.ndarray:
    """A closed line that begins and ends `distance` (m) further along; a corner nearby takes the seam."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    at = distance % along[-1]
    k = int(np.searchsorted(along, at, 'right')) - 1
    k = min(k, len(ring) - 2)
    gap = along[k + 1] - along[k]
    seam = ring[k] + (at - along[k]) / max(gap, 1e-12) * (ring[k + 1] - ring[k])
    return np.concatenate([[seam], ring[k + 1 : -1], ring[: k + 1], [seam]])


def gap_lines(
    polygon: Polygon, lines: list[np.ndarray], filled: list[Polygon], settings: PlanSettings
) -> list[np.ndarray]:
    """Middle lines of what the lines (and the `filled` polygons) leave open inside a polygon."""
    width = settings.bead_width
    laid = [_band(line, FILLED * width) for line in lines]
    left = polygon.difference(merged([*laid, *filled]))
    gaps = left.buffer(-NARROW * width).buffer(1.01 * NARROW * width).intersection(left)
    speck = (NARROW * width) ** 2
    return [
        line
        for gap in pieces(gaps)
        if gap.area > speck
        for line in (_closed_middle(gap) or medial_lines(gap, least=width / 3))
    ]


def _closed_middle(band: Polygon) -> list[np.ndarray]:
    """The middle line of a closed band (one hole) of one thickness; [] for any other shape."""
    if len(band.interiors) != 1:
        return []
    half = wall_width(band) / 2
    rings = pieces(Polygon(band.exterior).buffer(-half))
    if len(rings) != 1:
        return []
    line = rings[0].exterior
    points = shapely.points(shapely.get_coordinates(line.segmentize(STEP)))
    apart = shapely.distance(band.interiors[0], points)
    return [np.asarray(line.coords)] if np.abs(apart - half).max() < EVEN * half else []


def _band(line: np.ndarray, reach: float) -> Polygon:
    """What lies within `reach` (m) of a line; corners are filled, not rounded."""
    closed = len(line) > 3 and np.allclose(line[0], line[-1])
    curve = LinearRing(line) if closed else LineString(line)
    return curve.buffer(reach, join_style='mitre', mitre_limit=1.5)
