"""What one layer says: measured growth over what the material table expects, per block, and how growth follows metal.

Maps are averaged over square blocks one bead wide, so the waviness of the beads and the noise of the scanner drop out
and the blocks are about independent.

The exponent of height on metal is not read from one layer: places where beads end are always low, so the loop always
asks for more there, and growth on command would slope the wrong way. What is compared is how growth and command depart
from what the same place usually gets in layers of the same direction of travel (`BlockAverages`). The one layer
before would not do, since its noise is in the growth and, corrected, in the command as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .. import filters
from ..beads.bead_bias import MIN_CELLS, SEEN
from ..beads.model import BeadModel
from ..grids import CELLS_PER_BEAD, Resampler

MIN_BLOCKS = 4
LEVEL_MARGIN = 1 / 6  # bead widths from the edge of a layer, of the mean that says its level
MAX_ODD = 0.1  # layer heights that a cell may lie off the median ratio in that mean
# standard deviation of ln(command) below which a layer says nothing of the slope
EXCITATION = 0.015
MIN_NEWEST_WEIGHT = 0.1  # least weight of the newest layer in what a place usually gets
MIN_GROWTH = 0.2e-3  # m; thinner layers say nothing about the ratio
# Of the ratio, where the whole layer lies within a bead of its edge: how much of the metal beside the edge flows back
# onto the layer is not known.
EDGE_SIGMA = 0.15


@dataclass(frozen=True)
class LayerEvidence:
    """What one layer says about the process, from means over blocks of cells."""

    ratio: float  # measured growth over commanded growth
    ratio_sigma: float  # its standard uncertainty
    spread: float  # m, robust scatter of the blocks about the ratio
    commanded: float  # m, mean command
    blocks: int  # blocks that are known
    # (rows, cols) m, mean growth of every block, NaN where too little is known
    block_growth: np.ndarray
    block_commanded: np.ndarray  # (rows, cols) m, mean command of every block


def block_means(values: np.ndarray, known: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Means over size x size blocks (NaN where nothing is known), and the number of known cells."""
    rows, cols = (n // size * size for n in values.shape)
    shape = (rows // size, size, cols // size, size)
    n = known[:rows, :cols].reshape(shape).sum(axis=(1, 3))
    total = np.where(known, values, 0.0)[:rows, :cols].reshape(shape).sum(axis=(1, 3))
    return np.where(n > 0, total / np.maximum(n, 1), np.nan), n


@dataclass(frozen=True)
class Layer:
    """One layer as it was laid. Maps (rows, cols) in m."""

    before: np.ndarray  # surface it was laid on, NaN = unknown
    after: np.ndarray  # surface after it, NaN = unknown
    commanded: np.ndarray  # growth by the final setpoints (`commanded_growth`), 0 or NaN outside
    resolution: float  # m, edge of a cell
    bead_width: float  # m
    planned: np.ndarray | None = None  # growth of the plan; None = that of commanded

    @property
    def footprint(self) -> np.ndarray:
        """(rows, cols) bool: cells that were to grow by enough to say something."""
        return np.asarray(np.nan_to_num(self.commanded) > MIN_GROWTH)


def layer_evidence(layer: Layer, slope: float = 1.0) -> LayerEvidence | None:
    """Evidence of one layer; None when too little of it is known. slope: of growth on metal, as far as known.

    The ratio is that of growth to plan*(command/plan)^slope, so that it says the same whatever was commanded.
    Half a bead at the edge is left out; of a footprint no wider than a bead (a wall) the middle counts.
    """
    footprint = layer.footprint
    width = layer.bead_width / layer.resolution
    if not footprint.any():
        return None
    trusted = filters.away_from_edges(footprint, 0.5 * width)
    growth = layer.after - layer.before
    known = trusted & np.isfinite(growth)
    size = max(1, round(width))
    g, seen = block_means(growth, known, size)
    c, _ = block_means(layer.commanded, known, size)
    plan, _ = block_means(layer.commanded if layer.planned is None else layer.planned, known, size)
    _, there = block_means(growth, trusted, size)
    enough = (seen >= 0.6 * there) & (there >= 0.2 * size * size)
    g, c = np.where(enough, g, np.nan), np.where(enough, c, np.nan)
    if enough.sum() < MIN_BLOCKS:
        return None
    return _evidence(g, c, response(c, plan, slope), int(enough.sum()))


def edge_sigma(layer: Layer) -> float:
    """Standard uncertainty of a layer's ratio from the metal at its edge: EDGE_SIGMA by the fourth power of the share
    of its cells that lie within a bead of the edge."""
    if not layer.footprint.any():
        return 0.0
    depth = filters.depth(layer.footprint)[layer.footprint] * layer.resolution
    return EDGE_SIGMA * float(np.mean(depth < layer.bead_width)) ** 4


def response(commanded: np.ndarray, planned: np.ndarray, slope: float) -> np.ndarray:
    """Growth in m by planned*(commanded/planned)^slope: what a command leads to where the plan gives the plan."""
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.where(planned > 0, planned * (commanded / planned) ** slope, np.nan)


def _evidence(g: np.ndarray, c: np.ndarray, expected: np.ndarray, blocks: int) -> LayerEvidence:
    ratio = float(np.nanmedian(g / expected))
    residual = g - ratio * expected
    spread = float(1.4826 * np.nanmedian(np.abs(residual - np.nanmedian(residual))))
    mean = float(np.nanmean(c))
    ratio_sigma = 1.2533 * max(spread / mean, 5e-3) / math.sqrt(blocks)
    return LayerEvidence(ratio, ratio_sigma, spread, mean, blocks, *_coarser(g, c))


def _coarser(g: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Blocks two beads wide where the layer is big enough: metal runs off one of one bead, which hides the slope."""
    size = 2 if min(g.shape) >= 4 and np.isfinite(g).sum() >= 32 else 1
    known = np.isfinite(g)
    wide, n = block_means(g, known, size)
    command, _ = block_means(c, known, size)
    return np.where(n >= 0.75 * size * size, wide, np.nan), command


@dataclass(frozen=True)
class BlockAverages:
    """Means over the layers of one direction of ln(growth) and ln(command) per block; layers: seen of each block."""

    growth: np.ndarray
    commanded: np.ndarray
    layers: np.ndarray

    def slope(self, new: LayerEvidence) -> tuple[float, float]:
        """d ln(growth)/d ln(command) of a layer's departure from the averages, and its standard uncertainty.

        (1, inf) without excitation: commands depart by less than `EXCITATION`, or fewer than 8 blocks are known.
        """
        if self.growth.shape != new.block_growth.shape:
            return 1.0, math.inf
        y = _log(new.block_growth) - self.growth
        x = _log(new.block_commanded) - self.commanded
        good = np.isfinite(x) & np.isfinite(y) & (np.abs(y) < 1.0) & (self.layers > 0)
        if good.sum() < 8:
            return 1.0, math.inf
        x, y = x[good] - x[good].mean(), y[good] - y[good].mean()
        sxx = float((x**2).sum())
        if math.sqrt(sxx / x.size) < EXCITATION:
            return 1.0, math.inf
        slope = float((x * y).sum() / sxx)
        scatter = float(((y - slope * x) ** 2).sum()) / (x.size - 2)
        return slope, math.sqrt(scatter / sxx)

    @classmethod
    def after(cls, before: BlockAverages | None, new: LayerEvidence) -> BlockAverages:
        """With one more layer, of which every block counts at least `MIN_NEWEST_WEIGHT`; unknown blocks keep theirs."""
        g, c = _log(new.block_growth), _log(new.block_commanded)
        known = np.isfinite(g) & np.isfinite(c)
        if before is None or before.growth.shape != g.shape:
            zero = np.zeros(g.shape)
            before = cls(zero, zero, zero)
        layers = before.layers + known
        weight = np.where(known, np.maximum(1 / np.maximum(layers, 1), MIN_NEWEST_WEIGHT), 0.0)
        growth = before.growth + weight * np.where(known, g - before.growth, 0.0)
        commanded = before.commanded + weight * np.where(known, c - before.commanded, 0.0)
        return cls(growth, commanded, layers)


def _log(values: np.ndarray) -> np.ndarray:
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.log(np.where(values > MIN_GROWTH, values, np.nan))


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
    """The efficiency ratio that would have given a layer its height on average, up to `LEVEL_MARGIN` from its edge;
    None when too little of it is known.

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
