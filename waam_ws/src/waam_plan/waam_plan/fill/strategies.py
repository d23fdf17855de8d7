"""How a layer is filled: one table of strategies, each from polygons to chains of beads.

A strategy gets an `Area` and returns chains (hatch.Chain): lines in m that are welded without putting the arc out.
A new one is a function and a line in REGISTRY (and its name in settings.STRATEGIES).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from shapely import Polygon

from waam_plan.fill import contour, path
from waam_plan.fill.band import band_lines
from waam_plan.fill.hatch import Chain
from waam_plan.fill.linking import NONE_BELOW, StartsBelow, linked
from waam_plan.fill.medial import medial_lines, thin_and_thick
from waam_plan.fill.rings import contour_lines, gap_lines, spiral_lines
from waam_plan.fill.seam import seam_shift
from waam_plan.masks import ONE_BEAD
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import pieces, raster
from waam_process.grid import GridSpec

EDGE_METAL = 1.15  # of rings along the edge of a restored layer; see Strategy
EDGE_INSET = 0.28  # bead widths from that edge
CORNER = 0.33  # bead widths, radius of rings
STRIP = (0.5, 2.0)  # bead widths, pitches: mean width of walls that are laid as two beads


@dataclass(frozen=True)
class Area:
    """What a layer covers: polygons (m, work frame) and the same as cells (rows, cols) of the plan's grid."""

    polygons: list[Polygon]
    mask: np.ndarray
    spec: GridSpec
    settings: PlanSettings
    number: int  # of the layer, from 1
    more: float = (
        0.0  # beads across beyond the fewest, of strategies with rings; see `rings.spacing`
    )
    below: StartsBelow = NONE_BELOW  # what seams of rings keep away from

    def part(self, polygons: list[Polygon]) -> Area:
        """The same layer with other polygons."""
        return replace(self, polygons=polygons, mask=raster(polygons, self.spec))


def fill(area: Area) -> list[Chain]:
    """Chains of the strategy that the settings name."""
    return REGISTRY[area.settings.strategy].fill(area)


def restored(area: Area) -> list[Chain]:
    """Chains of the strategy that the settings name, in a layer of a restoration."""
    if area.settings.strategy in ('shell', 'zigzag'):
        return path.hatch_region(area.mask, area.spec, area.settings, area.number)[0]
    return rings_or_hatch(area) if area.settings.strategy == 'solid' else fill(area)


def solid(area: Area) -> list[Chain]:
    """Thin walls as one or two lines, bands around a hole as rings, everything else zig-zag."""
    walls, thick = contour.walls_and_rest(area.polygons, area.settings)
    bands = [p for p in thick if band_lines(p, area.settings)]
    rest = [p for p in thick if p not in bands]
    if not walls and not bands:
        return zigzag(area)
    lines = [[line] for p in walls for line in contour.wall_lines(p, area.settings, area.number)]
    chains = zigzag(area.part(rest)) if rest else []
    return [*chains, *(contours(area.part(bands)) if bands else []), *lines]


def zigzag(area: Area) -> list[Chain]:
    """Parallel beads, turned around at the edge with the arc on."""
    if not area.mask.any():
        return []
    return path.hatch_region(area.mask, area.spec, area.settings, area.number)[0]


def contours(area: Area) -> list[Chain]:
    """Rings at equal distances from the edge inwards, around an island at equal shares of the way to it; what they
    leave open gets a line along its middle."""
    s = area.settings

    def rings(p: Polygon) -> list[np.ndarray]:
        return band_lines(p, s, int(area.more)) or contour_lines(p, s, area.more)

    return _each(area, lambda p: _filled(p, rings(p), s))


def rings_or_hatch(area: Area) -> list[Chain]:
    """Of a restored layer: strips and closed walls for two beads as one ring or two, other walls under two beads as
    parallel beads, `contours` elsewhere."""
    walls = [p for p in area.polygons if is_narrow(p, area.settings)]
    rest = [p for p in area.polygons if p not in walls]
    strips = [p for p in walls if _is_strip(p, area.settings)]
    others = [p for p in walls if p not in strips]
    chains = zigzag(area.part(others)) if others else []
    for p in strips:
        runs = _hairpin(p, area.settings)
        chains += linked(runs, p, area.settings.pitch, area.number, True, area.below)
    return chains + (contours(area.part(rest)) if rest else [])


def is_narrow(polygon: Polygon, s: PlanSettings) -> bool:
    """Whether a restored polygon is too narrow for `contours`: under two beads, around a hole under two pitches."""
    return contour.is_wall(polygon, s, beads=2.0) and _open_or_strip(polygon, s)


def _open_or_strip(polygon: Polygon, s: PlanSettings) -> bool:
    return not polygon.interiors or _is_strip(polygon, s)


def _is_strip(polygon: Polygon, s: PlanSettings) -> bool:
    """Whether two beads beside each other fill a wall with ends or around a hole, with enough metal for both."""
    return (
        len(polygon.interiors) <= 1
        and STRIP[0] * s.bead_width <= contour.mean_width(polygon) <= STRIP[1] * s.pitch
    )


def _hairpin(polygon: Polygon, s: PlanSettings) -> list[Chain]:
    """A ring a quarter of the width inside: the ends of the strip are turns, and only one place has an arc start.
    Around a hole it is two rings, one along each side."""
    inset = contour.mean_width(polygon) / 4
    return _filled(polygon, contour.outlines(polygon, inset), s)


def spiral(area: Area) -> list[Chain]:
    """Rings joined to one line wherever they lie simply in each other."""
    s, shift = area.settings, seam_shift(area.number)
    return _each(area, lambda p: _filled(p, spiral_lines(p, s, shift, area.more), s))


def medial(area: Area) -> list[Chain]:
    """Thin walls and ribs as one bead along the middle, thicker places as rings."""
    return _each(area, lambda p: _arms_and_rings(p, area.settings))


def combined(area: Area) -> list[Chain]:
    """Zig-zag inside, then `contours` rings along the edge.

    Metal flows off a bead that has set; rings laid first would press the turns of the zig-zag together. Every ring has
    an arc start of its own, at the seam of the layer.
    """
    s = area.settings
    chains: list[Chain] = []
    for p in area.polygons:
        if contour.is_wall(p, s):
            chains += linked(_wall(p, s), p, s.pitch, area.number, below=area.below)
            continue
        rings, inside = _rings_and_hatch(p, area)
        chains += linked(inside, p, s.pitch, area.number, below=area.below)
        for ring in rings:
            chains += linked([[ring]], p, s.pitch, area.number, below=area.below)
    return chains


def _arms_and_rings(polygon: Polygon, s: PlanSettings) -> list[Chain]:
    thin, thick = thin_and_thick(polygon, ONE_BEAD * s.bead_width)
    runs = [[line] for p in thin for line in medial_lines(p, s.bead_width / 3)]
    return runs + [run for p in thick for run in _filled(p, contour_lines(p, s), s)]


def _rings_and_hatch(polygon: Polygon, area: Area) -> tuple[list[np.ndarray], list[Chain]]:
    """Closed rings along the edge, from the outermost inwards, and the chains inside them."""
    s = area.settings
    rings = [
        np.asarray(r.coords)
        for k in range(s.contours)
        for p in pieces(polygon.buffer(-s.first_ring - k * s.pitch))
        for r in (p.exterior, *p.interiors)
    ]
    inside = s.first_ring + (s.contours - 0.5) * s.pitch
    core = [p for p in pieces(polygon.buffer(-inside)) if p.area > (s.pitch / 2) ** 2]
    hatched = zigzag(area.part(core)) if core else []
    return rings, hatched + _gaps(polygon, rings, core, s)


def _filled(polygon: Polygon, lines: list[np.ndarray], s: PlanSettings) -> list[Chain]:
    return [[line] for line in lines] + _gaps(polygon, lines, [], s)


def _gaps(
    polygon: Polygon, lines: list[np.ndarray], filled: list[Polygon], s: PlanSettings
) -> list[Chain]:
    return [[line] for line in gap_lines(polygon, lines, filled, s)]


def _each(area: Area, runs_of: Callable[[Polygon], list[Chain]]) -> list[Chain]:
    """Chains of every polygon; thin walls are one or two lines whatever the strategy."""
    s = area.settings
    near = s.first_ring < s.bead_width / 2  # the edge, beside which the surface goes on
    chains: list[Chain] = []
    for p in area.polygons:
        thin = contour.is_wall(p, s) and _open_or_strip(p, s)
        runs = _wall(p, s) if thin else runs_of(p)
        chains += linked(runs, p, s.pitch, area.number, near, area.below)
    return chains


def _wall(polygon: Polygon, s: PlanSettings) -> list[Chain]:
    return [[line] for line in contour.wall_lines(polygon, s, 1)]


@dataclass(frozen=True)
class Strategy:
    """An entry of the table; `waam plan --help` prints `summary`.

    edge_metal: of the beads along the edge of a restored layer, over what the division of the metal gives them.
    The side of a bead falls off to the edge, so the division gives it more than it can carry; the surplus would
    stand inside of it.
    ring_inset: of a restored layer, bead widths between the outermost ring and the edge. The surface goes on beside a
    worn place, so there is no side that the ring has to keep, and half a bead inside it leaves a hollow along the edge.
    corner_radius: of the rings of a restored layer, bead widths. At a sharp corner a bead overlaps itself inside.
    """

    summary: str
    fill: Callable[[Area], list[Chain]]
    edge_metal: float = 1.0
    ring_inset: float = 0.5
    corner_radius: float = 0.0


REGISTRY: dict[str, Strategy] = {
    'solid': Strategy(
        'chosen per place: walls up to 1.5 beads thick as one or two lines; bands around a hole as rings; '
        'elsewhere zig-zag in builds, in restorations rings or zig-zag, as it lies more evenly',
        solid,
        edge_metal=EDGE_METAL,
        ring_inset=EDGE_INSET,
        corner_radius=CORNER,
    ),
    'shell': Strategy('one bead along the surface; open meshes are accepted', solid),
    'zigzag': Strategy(
        'parallel beads, few arc starts, flat; direction and angle alternate (--alternation)',
        zigzag,
    ),
    'contour': Strategy(
        'rings from the edge inwards: true edges, one seam per ring',
        contours,
        edge_metal=EDGE_METAL,
        ring_inset=EDGE_INSET,
        corner_radius=CORNER,
    ),
    'spiral': Strategy(
        'rings joined to one line: true edges, one arc start per simple region',
        spiral,
        edge_metal=EDGE_METAL,
        ring_inset=EDGE_INSET,
    ),
    'combined': Strategy(
        'contour outside (--set contours=1), zig-zag inside',
        combined,
        edge_metal=EDGE_METAL,
        ring_inset=EDGE_INSET,
    ),
    'medial': Strategy(
        'walls and ribs as thick as a bead: one along their middle; thicker places as contour',
        medial,
    ),
}
