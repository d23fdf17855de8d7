"""Rings that lie as evenly as they can: of several distances between them, the planner's process model chooses.

Rings of any distance leave a band in the middle, bands between an outline and a hole, corners. What is left open there,
or overlaps too much, is known before metal is laid: by dividing the layer among the pieces of path (`allocate`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from shapely import Polygon

from waam_plan.fill import path, strategies
from waam_plan.fill.band import band_lines
from waam_plan.fill.hatch import Chain
from waam_plan.lay.allocate import metal_heights, unevenness
from waam_process.grid import HeightGrid

# beads across beyond the fewest that are tried; with more, beads are so thin that a layer cannot lay less any more
MORE = (0.0, 0.25, 0.5, 0.75, 1.0)
WHOLE = (0.0, 1.0)  # the same around an island, where a band holds whole beads
RINGS = ('solid', 'contour', 'spiral')  # strategies that lay rings in a restored layer


def most_even(area: strategies.Area, planned: np.ndarray) -> list[Chain]:
    """Chains of all polygons, each with the distance of rings that comes nearest to `planned` (rows, cols) m."""
    if area.settings.strategy not in RINGS:
        return strategies.restored(area)
    return [chain for p in area.polygons for chain in _most_even(p, area, planned)]


def _most_even(polygon: Polygon, area: strategies.Area, planned: np.ndarray) -> list[Chain]:
    own = area.part([polygon])
    shared = area.settings.strategy != 'spiral' and band_lines(polygon, area.settings)
    choices = WHOLE if shared else MORE
    tried = [strategies.restored(replace(own, more=more)) for more in choices]
    return min(tried, key=lambda chains: _unevenness(chains, own, planned))


def _unevenness(chains: list[Chain], area: strategies.Area, planned: np.ndarray) -> float:
    flat = HeightGrid(area.spec, np.zeros(area.spec.shape))
    pieces = path.lay_out(chains, flat, area.settings)
    wanted = np.where(area.mask, planned, 0.0)
    height = metal_heights(pieces, wanted, area.mask, area.spec, area.settings)
    return unevenness(pieces, height, wanted, area.spec, area.settings)
