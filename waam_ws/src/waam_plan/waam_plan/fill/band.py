"""Rings around an island that share the way to the outline evenly, wherever it is longer or shorter."""

from __future__ import annotations

import math

import contourpy
import numpy as np
import shapely
from shapely import Polygon

from waam_plan.fill.rings import rounded
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import pieces

CELL = 0.25e-3  # m, of the field whose level lines are the rings
WOBBLE = 0.02e-3  # m: what simplifying may move
WIDE, NARROW = 0.9, 0.1  # quantiles of the width of a band
CROWDED = 0.55  # pitches: rings that come nearer to each other where the band is narrow are no way to fill it


def band_lines(polygon: Polygon, settings: PlanSettings, more: int = 0) -> list[np.ndarray]:
    """Closed lines (n, 2) m around the hole of a band, from the outline inwards; the outermost and the innermost one
    lie `first_ring` inside. [] for polygons that are no band, or one whose width differs too much.

    more: lines beyond the fewest that keep the pitch in all but the widest places.
    """
    inside = pieces(polygon.buffer(-settings.first_ring))
    if not _is_band(polygon) or len(inside) != 1 or not _is_band(inside[0]):
        return []
    outer, inner = Polygon(inside[0].exterior), Polygon(inside[0].interiors[0])
    x, y, share, width = _shares(outer, inner)
    if not width.size:
        return []
    gaps = max(1, math.ceil(np.quantile(width, WIDE) / settings.pitch - 1e-6)) + more
    if np.quantile(width, NARROW) / gaps < CROWDED * settings.pitch:
        return []
    field = contourpy.contour_generator(x, y, share)
    levels = (np.asarray(line) for k in range(1, gaps) for line in field.lines(k / gaps))
    between = [_polygon(line) for line in levels]
    radius = settings.corner_radius * settings.bead_width
    rings = [rounded(p, radius) for p in (outer, *between, inner) if p is not None]
    return [np.asarray(ring.exterior.coords) for ring in rings]


def _is_band(polygon: Polygon) -> bool:
    """Whether the polygon has one hole."""
    return len(polygon.interiors) == 1


def _shares(
    outer: Polygon, inner: Polygon
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """x (cols,), y (rows,) m; share (rows, cols) of the way from `outer` to `inner`, 0 .. 1; width (n,) m of the band
    at the cells inside."""
    x0, y0, x1, y1 = outer.bounds
    x, y = (np.arange(low, high + CELL, CELL) for low, high in ((x0, x1), (y0, y1)))
    at = np.meshgrid(x, y)
    points = shapely.points(*at)
    inside = shapely.contains_xy(outer, *at)
    depth = np.where(inside, shapely.distance(outer.exterior, points), 0.0)
    away = shapely.distance(inner, points)
    width = depth + away
    return x, y, depth / np.maximum(width, 1e-12), width[(depth > 0) & (away > 0)]


def _polygon(line: np.ndarray) -> Polygon | None:
    """What a closed level line encloses; None for one that is too short or touches itself."""
    polygon = Polygon(line).simplify(WOBBLE) if len(line) > 3 else Polygon()
    return polygon if isinstance(polygon, Polygon) and polygon.is_valid and polygon.area else None
