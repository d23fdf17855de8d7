"""Medial axis of a polygon: where a single bead runs through a thin wall, with branches and loops."""

from __future__ import annotations

import math

import numpy as np
import shapely
from scipy.spatial import QhullError, Voronoi
from shapely import LineString, MultiLineString, Polygon
from shapely.geometry.base import BaseGeometry

from waam_plan.slice.section import pieces

# of the radius: sides nearer to each other than that meet in a corner, not in a wall
OPPOSITE = 1.7
MAX_POINTS = 20_000  # on the outline
PROLONGED_RADIUS_SHARE = 0.35  # of the radius: by so much free ends are prolonged
CROSSING = 2.0  # widths: smaller thick places are where thin walls meet
WOBBLE = 0.05  # of the radius: what simplifying may move


def medial_lines(polygon: Polygon, least: float) -> list[np.ndarray]:
    """Lines (n, 2) along the middle, longest first; a closed one repeats its first point.

    Ends lie about half a thickness from the end of a wall. Where no line is left (a spot), one of length `least` (m)
    through its middle.
    """
    radius = float(shapely.maximum_inscribed_circle(polygon, tolerance=2e-5).length)
    raw = _ridges(polygon, max(radius / 3, polygon.length / MAX_POINTS))
    lines = _pruned(raw, max(radius, 1e-6)) if raw else []
    lines = [x for x in (_smooth(line, radius) for line in _joined(lines)) if x.length > least]
    if not lines:
        return [_spot(polygon, least)]
    lines.sort(key=lambda x: -x.length)
    return [_prolonged(line, lines, polygon, PROLONGED_RADIUS_SHARE * radius) for line in lines]


def _prolonged(
    line: LineString, lines: list[LineString], polygon: Polygon, by: float
) -> np.ndarray:
    """The line, longer by `by` (m) at its free ends where that stays inside: square ends of a wall get metal."""
    points = np.asarray(line.coords)
    for _ in range(2):
        points = points[::-1]
        tip = points[-1] + by * _heading(points[-2:])
        free = line.is_closed is False and all(
            other is line or other.distance(shapely.Point(points[-1])) > by for other in lines
        )
        if free and polygon.contains(LineString([points[-1], tip])):
            points = np.concatenate([points, [tip]])
    return points


def _ridges(polygon: Polygon, step: float) -> list[LineString]:
    """Pieces of the Voronoi diagram of the outline that lie inside and between opposite sides."""
    outline = shapely.get_coordinates(polygon.segmentize(step))
    outline = np.unique(np.round(outline, 9), axis=0)
    if len(outline) < 4:
        return []
    try:
        diagram = Voronoi(outline - outline.mean(axis=0))
    except QhullError:
        return []
    centre = diagram.vertices + outline.mean(axis=0)
    ends = np.array(diagram.ridge_vertices)
    sides = outline[diagram.ridge_points]
    finite = (ends >= 0).all(axis=1)
    ends, sides = ends[finite], sides[finite]
    apart = np.linalg.norm(sides[:, 0] - sides[:, 1], axis=1)
    radius = np.linalg.norm(centre[ends].mean(axis=1) - sides[:, 0], axis=1)
    shapely.prepare(polygon)
    inside = shapely.contains_xy(polygon, centre[:, 0], centre[:, 1])
    use = inside[ends].all(axis=1) & (apart >= OPPOSITE * radius)
    use &= np.linalg.norm(np.diff(centre[ends], axis=1)[:, 0], axis=1) > 1e-9
    return list(shapely.linestrings(np.round(centre[ends[use]], 9)))


def _pruned(ridges: list[LineString], shortest: float) -> list[LineString]:
    """Lines between junctions without the dead ends that are shorter than `shortest` (m)."""
    lines = _merged(ridges)
    ends = _ends(lines)
    kept = [
        line
        for line in lines
        if line.length >= shortest or not _dead_end(line, ends) or len(lines) == 1
    ]
    return _merged(kept) if kept else []


def _merged(lines: list[LineString]) -> list[LineString]:
    joined = shapely.line_merge(MultiLineString(lines))
    return list(getattr(joined, 'geoms', [joined]))


def _ends(lines: list[LineString]) -> dict[tuple, int]:
    count: dict[tuple, int] = {}
    for line in lines:
        for at in (line.coords[0], line.coords[-1]):
            count[at] = count.get(at, 0) + 1
    return count


def _dead_end(line: LineString, ends: dict[tuple, int]) -> bool:
    free = [ends[at] == 1 for at in (line.coords[0], line.coords[-1])]
    return any(free) and not all(free)


def _joined(lines: list[LineString]) -> list[LineString]:
    """Lines continued straight on through junctions, so that walls cross with few arc starts."""
    left = sorted((np.asarray(x.coords) for x in lines), key=len, reverse=True)
    out = []
    while left:
        line = left.pop(0)
        for _ in range(2):
            while (k := _straight_on(line, left)) is not None:
                line = _appended(line, left.pop(k))
            line = line[::-1]
        out.append(LineString(line))
    return out


def _straight_on(line: np.ndarray, others: list[np.ndarray]) -> int | None:
    """Which line goes on from the end of this one with a turn below 60 degrees, the straightest."""
    best, found = math.cos(math.radians(60)), None
    if np.allclose(line[0], line[-1]):
        return None
    ahead = _heading(line[::-1])
    for k, other in enumerate(others):
        for way in (other, other[::-1]):
            if np.allclose(way[0], line[-1], atol=1e-9):
                cosine = float(-ahead @ _heading(way))
                if cosine > best:
                    best, found = cosine, k
    return found


def _heading(line: np.ndarray) -> np.ndarray:
    """Unit vector from the first point of a line over its first few."""
    step = line[min(len(line) - 1, 5)] - line[0]
    return step / max(float(np.linalg.norm(step)), 1e-12)


def _appended(line: np.ndarray, other: np.ndarray) -> np.ndarray:
    way = other if np.allclose(other[0], line[-1], atol=1e-9) else other[::-1]
    return np.concatenate([line, way[1:]])


def _smooth(line: LineString, radius: float) -> LineString:
    return line.simplify(WOBBLE * radius)


def _spot(polygon: Polygon, length: float) -> np.ndarray:
    """A line of at most `length` along the longer side of a spot, through its middle, inside it."""
    box = np.asarray(polygon.minimum_rotated_rectangle.exterior.coords)
    sides = np.diff(box[:3], axis=0)
    longer = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    unit = longer / max(float(np.linalg.norm(longer)), 1e-12)
    middle = np.asarray(polygon.representative_point().coords[0])
    line = LineString([middle - unit * length / 2, middle + unit * length / 2])
    inside = [x for x in _lines(line.intersection(polygon)) if x.length > 1e-6]
    best = max(inside, key=lambda x: x.length, default=line)
    return np.asarray(best.coords)


def _lines(shape: BaseGeometry) -> list[LineString]:
    if isinstance(shape, LineString):
        return [shape]
    return [x for x in getattr(shape, 'geoms', []) if isinstance(x, LineString)]


def thin_and_thick(polygon: Polygon, width: float) -> tuple[list[Polygon], list[Polygon]]:
    """Arms of a polygon up to `width` (m) thick, and the rest. Where arms meet they stay arms."""
    core = polygon.buffer(-width / 2).buffer(width / 2 * 1.01).intersection(polygon)
    thick = [p for p in pieces(core) if p.area > (CROSSING * width) ** 2]
    arms = polygon.difference(shapely.union_all(thick)) if thick else polygon
    return [p for p in pieces(arms) if p.area > (width / 2) ** 2], thick
