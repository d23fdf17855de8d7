"""Paths for thin walls: one bead along the middle, or two along the outlines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from shapely import LineString, Polygon, maximum_inscribed_circle
from shapely.ops import substring

from waam_plan.fill.medial import medial_lines
from waam_plan.fill.seam import seam_shift
from waam_plan.masks import ONE_BEAD
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import pieces

# bead widths: two beads fill a wall up to this thickness; in a thicker one they leave a groove
TWO_BEADS = 1.5
LONG = 6.0  # outline over thickness: shorter pieces are spots, not walls


@lru_cache(maxsize=64)
def wall_width(polygon: Polygon) -> float:
    """Greatest thickness of a polygon, m: diameter of the largest circle that fits in. The newest are kept: a layer is
    laid out in several ways."""
    return 2 * float(maximum_inscribed_circle(polygon, tolerance=2e-5).length)


def mean_width(polygon: Polygon) -> float:
    """Mean thickness of a long polygon, m."""
    return float(2 * polygon.area / polygon.length)


def is_wall(polygon: Polygon, settings: PlanSettings, beads: float = TWO_BEADS) -> bool:
    """True when the polygon is nowhere thicker than so many beads."""
    return polygon.buffer(-beads / 2 * settings.bead_width).is_empty


def walls_and_rest(
    polygons: list[Polygon], settings: PlanSettings
) -> tuple[list[Polygon], list[Polygon]]:
    """Walls of one or two beads, and the others."""
    thin = [is_wall(p, settings) for p in polygons]
    pairs = list(zip(polygons, thin, strict=True))
    return [p for p, t in pairs if t], [p for p, t in pairs if not t]


def is_one_bead(polygon: Polygon, settings: PlanSettings) -> bool:
    """True for walls that are thicker than a bead only where they meet."""
    thin = (
        is_wall(polygon, settings, beads=2.0)
        and mean_width(polygon) <= ONE_BEAD * settings.bead_width
    )
    return thin and polygon.length > LONG * wall_width(polygon)


def wall_lines(polygon: Polygon, settings: PlanSettings, number: int) -> list[np.ndarray]:
    """Lines (n, 2) of a thin wall in layer `number`; a closed line repeats its first point.

    Up to ONE_BEAD thick: the middle line, with branches; thicker: one line along each outline. Seams of closed
    lines move from layer to layer, even layers run the other way.
    """
    width = wall_width(polygon)
    least = settings.bead_width / 3
    if width <= ONE_BEAD * settings.bead_width:
        lines = _middle(polygon, width, settings) or medial_lines(polygon, least)
    elif is_one_bead(polygon, settings):
        lines = medial_lines(polygon, least)
    else:
        lines = outlines(polygon, width / 4)
    return [_seamed(line, number) for line in lines]


def _middle(polygon: Polygon, width: float, settings: PlanSettings) -> list[np.ndarray] | None:
    """The middle line of a closed wall (one hole) or of a strip (no hole); None for anything more branched."""
    if len(polygon.interiors) == 1:
        ring = pieces(Polygon(polygon.exterior).buffer(-width / 2))
        ring = [p for p in ring if p.intersects(polygon)]
        return [np.asarray(ring[0].exterior.coords)] if len(ring) == 1 else None
    if polygon.interiors:
        return None
    return _strip(polygon, width, min(settings.edge_inset * settings.pitch, width / 2))


def _strip(polygon: Polygon, width: float, inset: float) -> list[np.ndarray] | None:
    """Middle of a strip: mean of its two sides, which run between the two points of the outline farthest apart.

    Near the ends that mean bends into a corner: they are cut off and the line is prolonged straight to `inset` (m)
    from the end. None when the strip is too short or not one.
    """
    ring = np.asarray(polygon.exterior.segmentize(width / 4).coords)[:-1]
    apart = np.linalg.norm(ring[:, None] - ring[None], axis=2)
    i, j = sorted(np.unravel_index(np.argmax(apart), apart.shape))
    one = LineString(ring[i : j + 1])
    two = LineString(np.concatenate([ring[j:], ring[: i + 1]])[::-1])
    t = np.linspace(0, 1, max(3, int(one.length / (width / 2))))
    middle = np.array(
        [
            (np.array(one.interpolate(s, True).coords[0]) + two.interpolate(s, True).coords[0]) / 2
            for s in t
        ]
    )
    line = LineString(middle)
    if line.length < 3 * width:
        return None
    points = np.asarray(substring(line, width, line.length - width).coords)
    ends = [
        _ahead(points[1], points[0], width - inset),
        _ahead(points[-2], points[-1], width - inset),
    ]
    points = np.concatenate([ends[:1], points, ends[1:]])
    return [points] if LineString(points).within(polygon) else None


def _ahead(a: np.ndarray, b: np.ndarray, distance: float) -> np.ndarray:
    """The point `distance` beyond b on the line from a."""
    return b + (b - a) / np.linalg.norm(b - a) * distance


def outlines(polygon: Polygon, inset: float) -> list[np.ndarray]:
    """Closed lines (n, 2) `inset` (m) inside the outline and around the holes."""
    lines: list[np.ndarray] = []
    for piece in pieces(polygon.buffer(-inset)):
        lines.extend(np.asarray(r.coords) for r in (piece.exterior, *piece.interiors))
    return lines


def _seamed(line: np.ndarray, number: int) -> np.ndarray:
    if np.allclose(line[0], line[-1]):
        shift = int(seam_shift(number) * (len(line) - 1))
        line = np.concatenate([line[shift:-1], line[: shift + 1]])
    return line[::-1] if number % 2 == 0 else line
