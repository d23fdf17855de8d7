"""Metal over the sides of a part: a bead is round, so full height at an edge needs metal beyond it.

The beads of a layer cover its section and `overrun` more at free sides; their middle stays on the section. A wall of
one bead keeps its lines. Where it is thinner than a bead it gets the metal of a bead, for the melt is no narrower.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from shapely import Polygon

from waam_plan import masks
from waam_plan.fill import contour
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import merged, outline, pieces, raster
from waam_process.grid import GridSpec

INSET = 0.4e-3  # m, least distance of bead ends from a free edge


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
    walls, rest = _divided(polygons, s)
    wide = [merged(rest).buffer(s.overrun, join_style='mitre')] if rest else []
    beads = [p.buffer(_widening(p, s)) for p in walls]
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


def _divided(polygons: list[Polygon], s: PlanSettings) -> tuple[list[Polygon], list[Polygon]]:
    """Walls of one or two beads, and the rest."""
    thin = [contour.is_wall(p, s) for p in polygons]
    pairs = list(zip(polygons, thin, strict=True))
    return [p for p, t in pairs if t], [p for p, t in pairs if not t]


def _widening(wall: Polygon, s: PlanSettings) -> float:
    """m, on each side, up to the width of a bead."""
    return max(0.0, (s.bead_width - contour.wall_width(wall)) / 2)
