"""How a restored layer is filled: with rings of one of several distances or with parallel beads, whichever lies more
evenly by the planner's process model.

Rings of any distance leave a band in the middle, bands between an outline and a hole, corners. What is left open there,
or overlaps too much, is known before metal is laid: by dividing the layer among the pieces of path (`allocate`). What a
pool does where the torch turns back beside it is not in that model, so turns back count on their own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from shapely import Polygon

from waam_plan import masks
from waam_plan.fill import path, strategies
from waam_plan.fill.band import band_lines
from waam_plan.fill.hatch import Chain
from waam_plan.fill.path import Pieces
from waam_plan.layers.allocate import SEEN, metal_heights, unevenness, waves
from waam_plan.layers.forecast import growth, pieces_of
from waam_plan.layers.travel import thinnest_bead
from waam_plan.plan import PlannedLayer
from waam_plan.settings import JUDGED_RIM, PlanSettings
from waam_process.grid import GridSpec, HeightGrid

# beads across beyond the fewest that are tried; with more, beads are so thin that a layer cannot lay less any more
MORE = (0.0, 0.25, 0.5, 0.75, 1.0)
WHOLE = (0.0, 1.0)  # the same around an island, where a band holds whole beads
# what a share of the way that turns back counts beside the unevenness, and the cosine of a turn back
TURN_BACK, BACK = 0.5, -0.5
RINGS = ('solid', 'contour', 'spiral')  # strategies that lay rings in a restored layer


def most_even(area: strategies.Area, planned: np.ndarray) -> list[Chain]:
    """Chains of all polygons, each with the distance of rings that comes nearest to `planned` (rows, cols) m."""
    if area.settings.strategy not in RINGS:
        return strategies.restored(area)
    return [chain for p in area.polygons for chain in _most_even(p, area, planned)]


def _most_even(polygon: Polygon, area: strategies.Area, planned: np.ndarray) -> list[Chain]:
    own = area if len(area.polygons) == 1 else area.part([polygon])
    shared = area.settings.strategy != 'spiral' and band_lines(polygon, area.settings)
    choices = WHOLE if shared else MORE
    tried = [strategies.restored(replace(own, more=more)) for more in choices]
    return min(tried, key=lambda chains: _unevenness(chains, own, planned))


def best(layers: Sequence[PlannedLayer], spec: GridSpec, settings: PlanSettings) -> int:
    """Which of several ways to lay one layer costs least."""
    if len(layers) == 1:
        return 0
    resolution = spec.resolution
    rim, bead = JUDGED_RIM / resolution, settings.bead_width / resolution
    seen = masks.judged(layers[0].planned > 0, rim, bead)
    return int(np.argmin([cost(layer, seen, spec, settings) for layer in layers]))


def cost(layer: PlannedLayer, seen: np.ndarray, spec: GridSpec, settings: PlanSettings) -> float:
    """By how much a layer is expected to miss what it should become, in its mean thickness: RMS of the waves that it
    keeps on the cells `seen` (rows, cols) if the process model is right, and a charge for the places where the torch
    turns back. Infinite for a layer without metal."""
    if not layer.deposits:
        return math.inf
    if not seen.any():
        return 0.0
    on = layer.planned > 0
    blur = SEEN * settings.bead_width / spec.resolution
    off = waves(growth(layer, spec, settings) - layer.planned, on, blur)
    uneven = np.std(off[seen]) / layer.planned[seen].mean()
    return float(uneven) + TURN_BACK * turning_back(pieces_of(layer), settings.bead_width)


def turning_back(pieces: Pieces, width: float) -> float:
    """Share of the way within half a bead width (m) of a place where the torch comes back beside its own bead."""
    step = (pieces.end - pieces.start)[:, :2]
    step = step / np.maximum(np.linalg.norm(step, axis=1), 1e-12)[:, None]
    way = np.cumsum(pieces.length)
    before = np.searchsorted(way, way - width / 2)
    after = np.minimum(np.searchsorted(way, way + width / 2), len(way) - 1)
    joined = pieces.chain[before] == pieces.chain[after]
    back = joined & ((step[before] * step[after]).sum(axis=1) < BACK)
    return float(pieces.length[back].sum() / way[-1])


def _unevenness(chains: list[Chain], area: strategies.Area, planned: np.ndarray) -> float:
    flat = HeightGrid(area.spec, np.zeros(area.spec.shape))
    pieces = path.lay_out(chains, flat, area.settings)
    wanted = np.where(area.mask, planned, 0.0)
    height = metal_heights(pieces, wanted, area.mask, area.spec, area.settings)
    height = np.maximum(
        height, thinnest_bead(area.settings)
    )  # what is asked for below is laid all the same
    return unevenness(pieces, height, wanted, area.spec, area.settings)
