"""Level of a layer: the efficiency ratio that would have given it its height on average."""

from __future__ import annotations

import numpy as np

from ..beads.bead_bias import MIN_CELLS, SEEN
from ..beads.model import BeadModel
from ..grids import CELLS_PER_BEAD, Resampler
from .evidence import MIN_GROWTH

LEVEL_MARGIN = 1 / 6  # bead widths from the edge of a layer, of the mean that says its level
MAX_ODD = 0.1  # layer heights that a cell may lie off the median ratio in that mean


def level(
    model: BeadModel,
    growth: np.ndarray,
    plan: np.ndarray,
    commanded: np.ndarray,
    resolution: float,
    slope: float,
    lag: float,
    missing: np.ndarray | float = 0.0,
) -> float | None:
    """The mean up to `LEVEL_MARGIN` from the edge; None when too little of the layer is known.

    growth, plan, commanded (rows, cols): m, growth NaN where unseen; resolution: m; slope: of growth on metal; lag: m
    of the metal along the travel; missing (model.shape): share of the planned height that the beads were known to lack.
    """
    footprint = np.nan_to_num(commanded) > MIN_GROWTH
    rim = round(LEVEL_MARGIN * model.width / resolution)
    inside = footprint & np.isfinite(growth) & (plan > MIN_GROWTH)
    around = np.pad(footprint, rim)
    for axis, step in ((0, rim), (0, -rim), (1, rim), (1, -rim)):
        inside &= np.roll(around, step, axis)[rim : rim + len(inside), rim : rim + inside.shape[1]]
    grid = Resampler.of(plan.shape, resolution, model.width / CELLS_PER_BEAD)
    weight = grid.mean(inside.astype(float))
    share = np.maximum(weight, SEEN)
    grown, height = (grid.mean(np.where(inside, v, 0.0)) / share for v in (growth, plan))
    relative = np.divide(commanded, plan, out=np.full(plan.shape, np.nan), where=plan > MIN_GROWTH)
    asked = model.of_cells(relative, resolution) ** slope
    expected = model.growth(asked, lag) * height
    use = (weight > SEEN) & (expected > MIN_GROWTH)
    if np.count_nonzero(use) < MIN_CELLS:
        return None
    weight, expected = weight[use], expected[use]
    grown = (grown + missing * height)[use]
    ratio = float(np.median(grown / expected))
    odd = MAX_ODD * height[use]  # beyond it the scan is at fault
    rest = np.clip(grown - ratio * expected, -odd, odd)
    return ratio + float(weight @ rest) / float(weight @ expected)
