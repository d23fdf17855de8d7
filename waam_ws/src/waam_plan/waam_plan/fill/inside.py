"""Keeps a path inside the section: what crosses its edge is moved back, what cannot be moved is cut.

Two points of the section shrunk by MARGIN that are at most twice MARGIN apart have all of their connection in the
section: every point of it lies within MARGIN of one of them.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points, substring

from waam_plan.fill.path import Pieces
from waam_plan.slice.section import merged, pieces

MARGIN = 0.05e-3  # m
MIN_PIECE = 1e-6  # m, shorter pieces are left out
MAX_WAY_AROUND_CORNER = (
    3e-3  # m, way along the edge around a corner; a bead whose way is longer is cut there
)


def keep_inside(found: Pieces, polygons: list[Polygon]) -> Pieces:
    """The same pieces where they lie in the polygons, moved to their edge where they do not."""
    area = merged(polygons)
    shapely.prepare(area)
    lines = shapely.linestrings(np.stack([found.start[:, :2], found.end[:, :2]], axis=1))
    bad = np.flatnonzero(~shapely.contains(area, lines))
    if not len(bad):
        return found
    core = area.buffer(-MARGIN)
    if core.is_empty:
        return found
    moved = {int(i): _moved(found.start[i], found.end[i], area, core) for i in bad}
    return _with(found, moved, area)


def _moved(a: np.ndarray, b: np.ndarray, area: BaseGeometry, core: BaseGeometry) -> np.ndarray:
    """(n, 3) points from a to b in the shrunk section, at most 2 MARGIN apart before they were moved."""
    n = max(1, int(np.ceil(np.linalg.norm(b[:2] - a[:2]) / (1.9 * MARGIN))))
    points = a + np.linspace(0, 1, n + 1)[:, None] * (b - a)
    outside = ~shapely.contains_xy(core, points[:, 0], points[:, 1])
    for i in np.flatnonzero(outside):
        at = nearest_points(core, shapely.Point(points[i, :2]))[0]
        points[i, :2] = at.x, at.y
    return _thinned(_around(points, area, core), area)


def _around(points: np.ndarray, area: BaseGeometry, core: BaseGeometry) -> np.ndarray:
    """The same points, and where the chord of two of them leaves the section the edge of the core between them."""
    chords = shapely.linestrings(np.stack([points[:-1, :2], points[1:, :2]], axis=1))
    rows = [points[:1]]
    for a, b, inside in zip(points, points[1:], shapely.contains(area, chords), strict=False):
        if not inside:
            corners = _along_edge(a[:2], b[:2], core)
            share = np.linspace(0, 1, len(corners) + 2)[1:-1, None]
            rows.append(np.hstack([corners, a[2:] + share * (b[2:] - a[2:])]))
        rows.append(b[None])
    return np.vstack(rows)


def _along_edge(a: np.ndarray, b: np.ndarray, core: BaseGeometry) -> np.ndarray:
    """(n, 2) corners of the edge of the core between two of its points, none when the way is long."""
    edge = min(
        _edges(core), key=lambda r: r.distance(shapely.Point(a)) + r.distance(shapely.Point(b))
    )
    at, to = (edge.project(shapely.Point(p)) for p in (a, b))
    twice = LineString([*edge.coords, *edge.coords[1:]])  # the shorter way may lead over the begin
    if abs(to - at) > edge.length / 2:
        at, to = (at + edge.length, to) if at < to else (at, to + edge.length)
    way = np.asarray(substring(twice, at, to).coords)
    return way[1:-1] if abs(to - at) < MAX_WAY_AROUND_CORNER else np.empty((0, 2))


def _edges(core: BaseGeometry) -> list[BaseGeometry]:
    rings: list[BaseGeometry] = []
    for polygon in pieces(core):
        rings += [polygon.exterior, *polygon.interiors]
    return rings


def _thinned(points: np.ndarray, area: BaseGeometry) -> np.ndarray:
    """The fewest points whose chords all stay inside; all points when no choice does."""
    line = LineString(points[:, :2])
    for tolerance in (0.2e-3, 0.05e-3, 0.02e-3):
        short = np.asarray(line.simplify(tolerance).coords)
        chords = shapely.linestrings(np.stack([short[:-1], short[1:]], axis=1))
        if len(short) > 1 and shapely.contains(area, chords).all():
            keep = [int(np.argmin(np.linalg.norm(points[:, :2] - p, axis=1))) for p in short]
            keep[0], keep[-1] = 0, len(points) - 1
            return points[np.unique(keep)]
    return points


def _with(found: Pieces, moved: dict[int, np.ndarray], area: BaseGeometry) -> Pieces:
    """Pieces with the moved ones in place; neighbours follow, jumps out of the section end a chain."""
    start, end = found.start.copy(), found.end.copy()
    for i, points in moved.items():
        for k, at, mine in ((i - 1, points[0], end), (i + 1, points[-1], start)):
            if 0 <= k < len(start) and found.chain[k] == found.chain[i] and k not in moved:
                mine[k] = at
    rows = []
    for i in range(len(start)):
        corners = moved[i] if i in moved else np.array([start[i], end[i]])
        rows += [(a, b, i) for a, b in zip(corners, corners[1:], strict=False)]
    begin, finish = (np.array([r[k] for r in rows]) for k in (0, 1))
    of = np.array([r[2] for r in rows])
    chords = shapely.linestrings(np.stack([begin[:, :2], finish[:, :2]], axis=1))
    keep = shapely.contains(area, chords) & (np.linalg.norm(finish - begin, axis=1) > MIN_PIECE)
    begin, finish, of = begin[keep], finish[keep], of[keep]
    return Pieces(begin, finish, found.bead[of], _renumbered(begin, finish, found.chain[of]))


def _renumbered(start: np.ndarray, end: np.ndarray, chain: np.ndarray) -> np.ndarray:
    """Chain numbers that also change where a piece does not begin at the end of the one before."""
    if not len(start):
        return chain
    new = np.ones(len(start), bool)
    new[1:] = (chain[1:] != chain[:-1]) | (np.linalg.norm(start[1:] - end[:-1], axis=1) > 1e-9)
    return np.cumsum(new) - 1
