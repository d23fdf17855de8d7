"""Metal over the sides of a part: a bead is round, so full height at an edge needs metal beyond it.

The beads of a layer cover its section and `overrun` more at free sides; their middle stays on the section. A wall of
one bead keeps its lines. Where it is thinner than a bead it gets the metal of a bead, for the melt is no narrower.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.spatial import Voronoi
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from waam_plan import masks
from waam_plan.fill import contour
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import merged, outline, pieces, raster
from waam_process.grid import GridSpec

INSET = 0.4e-3  # m, least distance of bead ends from a free edge
CELLS_APART = 1.5  # between covers that do not meet, for any direction of a slit
FAR_CORNERS = 1e2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])  # m


@dataclass(frozen=True)
class Cover:
    """What the beads of a layer cover."""

    polygons: list[Polygon]  # m, that the strategy fills
    mask: np.ndarray  # bool (rows, cols), the same as cells
    metal: np.ndarray  # bool (rows, cols), cells that metal is planned for


def of_section(polygons: list[Polygon], on: np.ndarray, spec: GridSpec, s: PlanSettings) -> Cover:
    """Of a build: all sides are free. on: the cells of the polygons."""
    if s.overrun <= 0 or s.strategy == 'shell':
        return Cover(polygons, on, on)
    walls, rest = contour.walls_and_rest(polygons, s)
    wide = [merged(rest).buffer(s.overrun, join_style='mitre')] if rest else []
    slits = _slits(walls, rest, s.overrun, CELLS_APART * spec.resolution)
    if slits:
        wide, walls = ([p.difference(merged(slits)) for p in some] for some in (wide, walls))
    beads = [p.buffer(_widening(p, s)) for wall in walls for p in pieces(wall)]
    filled = pieces(merged([*walls, *wide]))
    return Cover(
        filled,
        raster(filled, spec),
        on | raster(pieces(merged([*beads, *wide])), spec),
    )


def of_mask(
    on: np.ndarray, lowest: np.ndarray, free: np.ndarray, spec: GridSpec, s: PlanSettings
) -> Cover:
    """Of a restoration. Bool (rows, cols): on, cells of the layer; lowest, those where it is the first; free, those
    beside the part."""
    polygons = outline(on, spec)
    if s.overrun <= 0:
        return Cover(polygons, on, on)
    walls = [p for p in polygons if contour.is_one_bead(p, s)]
    thin = on & raster([p.buffer(spec.resolution) for p in walls], spec)
    rest = masks.overrun(on & ~thin, free, s.overrun / spec.resolution)
    widening = max((_widening(p, s) for p in walls), default=0.0)
    metal = rest | thin | masks.overrun(thin & ~lowest, free, widening / spec.resolution)
    cover = rest | thin
    return Cover(outline(cover, spec), cover, metal)


def settings_within(s: PlanSettings) -> PlanSettings:
    """Bead ends stay on the part although their beads cover its sides: inset from the edge of the cover."""
    return replace(s, edge_inset=min(max(s.edge_inset, (s.overrun + INSET) / s.pitch), 1.0))


def _slits(
    walls: list[Polygon], rest: list[Polygon], overrun: float, apart: float
) -> list[Polygon]:
    """What stays free between pieces whose covers would meet, `apart` (m) wide: beads would cross the slit, and each of
    them would put the arc out there."""
    grown = [(p, overrun) for p in rest] + [(p, 0.0) for p in walls]
    out: list[Polygon] = []
    for n, (a, over) in enumerate(grown[: len(rest)]):
        for b, under in grown[n + 1 :]:
            reach = over + under + apart
            if a.distance(b) < reach:
                near = a.buffer(reach).intersection(b.buffer(reach))
                out += pieces(_between(a, b, near, apart / 2).buffer(apart / 2))
    return out


def _between(a: Polygon, b: Polygon, near: BaseGeometry, step: float) -> BaseGeometry:
    """The line in `near` that is as far from a as from b, from points of their outlines a `step` (m) apart."""
    some = [shapely.get_coordinates(p.boundary.intersection(near).segmentize(step)) for p in (a, b)]
    middle = np.concatenate(some).mean(axis=0)
    found = Voronoi(
        np.concatenate([*some, middle + FAR_CORNERS])
    )  # FAR_CORNERS: so that all lines end
    ends, of = np.array(found.ridge_vertices), found.ridge_points
    first, both = len(some[0]), len(some[0]) + len(some[1])
    parts = (of.min(axis=1) < first) & (of.max(axis=1) >= first) & (of.max(axis=1) < both)
    lines = shapely.linestrings(found.vertices[ends[parts & (ends >= 0).all(axis=1)]])
    return shapely.union_all(lines).intersection(near)


def _widening(wall: Polygon, s: PlanSettings) -> float:
    """m, on each side, up to the width of a bead."""
    return max(0.0, (s.bead_width - contour.wall_width(wall)) / 2)
