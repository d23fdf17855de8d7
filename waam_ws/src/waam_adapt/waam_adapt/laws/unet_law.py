"""The law that solves for the beads with what a U-Net predicts of them.

The network sees the plan's geometry only (`beads.plan_geometry`) and says where a layer will grow more or less than the
bead model expects: humps in turns, hollows beside them, links between rings, places that only one pass reaches. The
solver lays less where more will grow. Nothing that the scan shows goes into the network, so it cannot chase noise. What
the loop still leaves of such a surface is told by a regression beside it (`beads.residual`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from .. import filters
from ..beads import headroom, plan_geometry, plan_level, residual
from ..beads.model import inner_cells
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import Correction, CorrectionInput, Predicted
from . import net, net_file
from .bead_solver_law import BeadSolver
from .explicit import DampedInverse

NO_MODEL = 'none'  # in place of a file of weights: the bead model without a network
DOUBT = 0.25  # share of the planned height: predicted error at which the confidence is a half
# Share of the planned height that is predicted at most. Setpoints cannot fill a deeper hollow within a bead; a hump is
# avoided by laying less. In walls narrower than a bead, a hump that one layer leaves stands in the hollow of the next
# one, laid otherwise.
HOLLOW, HUMP, IN_WALL = 0.15, 0.4, 0.05
SMOOTH = 1.0  # cells: sigma of what is predicted; shorter waves setpoints cannot make


@dataclass(frozen=True)
class UNetLaw:
    """`bead_solver` with a U-Net. network None: `broken` says why, and every answer announces it; without
    words (NO_MODEL) it is `bead_solver`.

    confidence of the result: that of the bead solver times 1/(1 + (sigma/DOUBT)^2), sigma predicted by the network.
    """

    solver: BeadSolver
    network: net.Network | None
    broken: str = ''
    name: str = 'unet'

    @classmethod
    def load(cls, path: str, explicit: DampedInverse) -> UNetLaw:
        """path '' = the packaged weights, NO_MODEL = none."""
        solver = BeadSolver(explicit, cls.name)
        if path == NO_MODEL:
            return cls(solver, None)
        try:
            return cls(solver, _model(Path(path) if path else net_file.PACKAGED))
        except net.ModelError as e:
            return cls(solver, None, str(e))

    def predict(self, request: CorrectionInput) -> Predicted:
        """What the layer will do beside the bead model; all 0, with the reason, where the network cannot say."""
        cell = request.bead_width / CELLS_PER_BEAD
        grid = Resampler.of(request.z.shape, request.resolution, cell)
        nothing = Predicted(np.zeros(grid.shape), np.full(grid.shape, DOUBT))
        if self.network is None or not request.paths or not request.footprint.any():
            return replace(nothing, doubt=self.broken)
        x = plan_geometry.build(request, grid)
        if not x[0].any():
            return replace(nothing, doubt='the layer covers no cell of the bead model')
        if odd := self.network.unlike(
            plan_geometry.SUMMARIES, plan_geometry.summary(x, request.bead_width)
        ):
            return replace(nothing, doubt=f'plan unlike the training: {odd}')
        box = plan_geometry.box(x)
        shown = x[:, *box]
        told, log_error = _answer(self.network, shown.tobytes(), shown.shape)
        if not (np.isfinite(told).all() and np.isfinite(log_error).all()):
            return replace(nothing, doubt='the network gave an answer that is not finite')
        growth, sigma = nothing.growth, nothing.sigma
        growth[box], sigma[box] = told, np.exp(log_error.astype(float))
        inner = inner_cells(request, grid)
        # how high the map is on average is no part of it: that is told by the figures of the plan
        growth = (growth - (growth * inner).sum() / max(inner.sum(), 1e-9)) * inner
        spread = np.maximum(gaussian_filter(inner, SMOOTH), 1e-3)
        growth = np.where(x[0] > 0, gaussian_filter(growth, SMOOTH) / spread, 0.0)
        wide = filters.thickest(request.footprint) * request.resolution >= request.bead_width
        hollow, hump = (HOLLOW, HUMP) if wide else (IN_WALL, IN_WALL)
        growth, weights = np.clip(growth, -hollow, hump), self.network.weights
        found = Predicted(growth, sigma, self.network.digest)
        if not wide:  # walls rise otherwise: there the layers so far say more
            return found
        found = replace(found, level=plan_level.level(shown, weights))
        if request.of_other_planner:  # what the loop leaves was learned on plans of our own
            return found
        surface = residual.surface(request, grid, x, growth)
        left = residual.told(surface, weights)
        return replace(found, left=left, headroom=headroom.under_thinner(request, growth, inner))

    def correct(self, request: CorrectionInput) -> Correction:
        """The solver's answer with what the network predicts; where it cannot, the reason and fallback."""
        predicted = request.predicted or self.predict(request)
        result = self.solver.correct(request.told(predicted))
        if result.fallback:
            return result
        if predicted.doubt:
            reason = f'{self.name}: {predicted.doubt}; the bead model answers without the network'
            return replace(result, fallback=True, reasons=(reason, *result.reasons))
        if not predicted.digest:
            return result
        grid = Resampler.of(
            request.z.shape, request.resolution, request.bead_width / CELLS_PER_BEAD
        )
        sure = np.clip(grid.fine(1 / (1 + (predicted.sigma / DOUBT) ** 2)), 0.0, 1.0)
        return replace(
            result,
            confidence=result.confidence * sure,
            model_hash=predicted.digest,
            reasons=(*result.reasons, *self._remarks(predicted)),
        )

    def _remarks(self, predicted: Predicted) -> tuple[str, ...]:
        """What the job has left the network to say, for report and record."""
        if math.isnan(predicted.weight):
            return ()
        text = f'{self.name}: weight of the network {predicted.weight:.2f}'
        level = math.expm1(predicted.level)
        return (f'{text}, level of this layer {level:+.1%}' if level else text,)


@lru_cache(maxsize=8)
def _answer(
    network: net.Network, shown: bytes, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Of the network to an input (float32, of `shape`). The newest are kept, for those of an announced layer."""
    found = network(np.frombuffer(shown, np.float32).reshape(shape))
    for kept in found:
        kept.flags.writeable = False
    return found


@lru_cache(maxsize=4)
def _model(path: Path) -> net.Network:
    """Read once per process: the weights do not change under a running job."""
    return net_file.load(path, plan_geometry.CHANNELS)
