"""Relative layer height of every segment of the beads, by bounded least squares through the nominal model.

minimise sum(w*(need - A*x)^2) + small*(x - x0)^2 + smooth*(differences of x - x0 along the bead)^2, low <= x <= high

by accelerated projected gradients (Beck and Teboulle 2009, FISTA) from x0: a fixed number of steps, so same input,
same bits. w is the share of a cell that is known and away from the edge: the outermost flank falls behind for good and
is not to be filled.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..grids import Resampler
from ..types import RATIO_HIGH, RATIO_LOW, BeadDeviation, CorrectionInput
from . import kernels
from .model import MARGIN, TINY, BeadModel, bead_model, inner_mean

# of the typical diagonal of A'wA. SMOOTH is large: a solution that follows the nominal model closely alternates from
# segment to segment, and a cell whose beads are not quite the model's answers otherwise (docs/adaptation.md).
SMALL, SMOOTH = 0.0005, 0.15
END_HIGH = 4.0  # relative layer height up to which the end of a bead may be filled (crater filling)
END_REACH = 0.4  # bead widths from arc on or off to the middle of a segment that counts as its end
# Share of an end's metal on cells that count from which it may be filled so far. In the corner of a part most of it
# falls on the flank, where it slides off and makes the crater deeper.
COUNTED = 0.35
# Bead widths from arc on and off within which the differences count less, and their share: craters are filled there.
LOOSE, LOOSE_SHARE = 1.0, 0.02
STEPS = 30


def refine(
    request: CorrectionInput,
    ratio: np.ndarray,
    gain: float,
    grid: Resampler,
) -> np.ndarray:
    """(rows, cols) relative layer height that the beads of `request.paths` need.

    ratio (rows, cols): what a law asks of every cell; kept away from the beads, and where nothing is known.
    gain: share of the height error that the layer is to remove. grid: of the bead model.
    """
    learned = request.learned or BeadDeviation(np.zeros(grid.shape))
    model = bead_model(request.paths, grid.shape, request.bead_width)
    footprint = request.footprint
    known = footprint & np.isfinite(request.error)
    planned = np.where(footprint, request.planned, 1.0)
    error = request.error * learned.scale / planned
    margin = MARGIN * request.bead_width / request.resolution
    error, weight = inner_mean(error, known, footprint, grid, margin)
    missing = learned.missing
    if request.forecast is not None:
        missing = missing - request.forecast.shape
    need = (gain * error + missing) / learned.slope
    start = model.of_cells(ratio, request.resolution)
    asked = solve(
        model, need, weight, start, learned.lag, ratio_high=request.ratio_high, fill=learned.fill
    )
    solved = model.on_cells(asked)
    return ratio + grid.fine(model.near.astype(float)) * (grid.fine(solved) - ratio)


def solve(
    model: BeadModel,
    need: np.ndarray,
    weight: np.ndarray,
    start: np.ndarray,
    lag: float,
    ratio_high: float = 0.0,
    fill: float = 1.0,
) -> np.ndarray:
    """(m,) relative layer height of the segments.

    need, weight (rows, cols): growth that is wanted beside the plan's, in planned heights, and how much a cell counts.
    start (m,): x0, what is asked where nothing is known. lag: m. ratio_high: see `CorrectionInput`; fill: see
    `BeadDeviation`.
    """
    a, w = model.spread @ model.driven(lag) @ model.read, weight.ravel()
    entries = a.data, a.indices.astype(np.uint32), a.indptr.astype(np.uint32), w
    metal = np.asarray(a.sum(axis=0)).ravel()
    high = _highest(model, (a.T @ w) / np.maximum(metal, TINY), ratio_high, fill) - 1
    low, x0 = RATIO_LOW - 1, start - 1
    # sums of the rows are no less than the curvature, for nothing in A'wA is negative
    diagonal, rows = kernels.curvature(*entries, len(x0))
    typical = float(np.median(diagonal[diagonal > 0])) if diagonal.any() else 1.0
    small, smooth = SMALL * typical, SMOOTH * typical
    joined = (model.first[1:] == model.first[:-1]).astype(float)
    joined[np.minimum(model.to_arc[1:], model.to_arc[:-1]) < LOOSE * model.width] *= LOOSE_SHARE
    wanted = need.ravel()

    def gradient(x: np.ndarray) -> np.ndarray:
        d = x - x0
        fall = smooth * joined * np.diff(d)
        g = kernels.gradient(*entries, wanted, x) + small * d
        g[1:] += fall
        g[:-1] -= fall
        return g

    steepest = rows + small + 4 * smooth
    return 1 + _projected(gradient, np.clip(x0, low, high), low, high, steepest)


def _highest(model: BeadModel, counted: np.ndarray, ratio_high: float, fill: float) -> np.ndarray:
    """(m,) relative layer height that each segment may be asked for; counted (m,): share of its metal on cells that
    count, 0 where nothing is known. ratio_high: of all segments, 0 = as they are."""
    filled = 1 + fill * (END_HIGH - 1) * np.minimum(counted / COUNTED, 1.0)
    at_end = (model.to_arc < END_REACH * model.width) & (counted > 0)
    return np.minimum(np.where(at_end, filled, RATIO_HIGH), ratio_high or np.inf)


def _projected(
    gradient: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    low: float,
    high: np.ndarray,
    steepest: np.ndarray,
) -> np.ndarray:
    """FISTA with a step of its own for every segment; steepest (m,): at least the curvature."""
    ahead, t = x, 1.0
    for _ in range(STEPS):
        new = np.clip(ahead - gradient(ahead) / steepest, low, high)
        t_new = 0.5 * (1 + (1 + 4 * t * t) ** 0.5)
        ahead = new + (t - 1) / t_new * (new - x)
        x, t = new, t_new
    return x
