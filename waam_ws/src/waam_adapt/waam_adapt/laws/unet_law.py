"""The bead solver with a U-Net: what the base law would leave of a layer is told before it is laid, and asked for less.

The network sees the plan, the surface and what the job has shown (`features`). It was trained on layers that the loop
itself has laid: there the setpoints follow from surface and plan, so that what it tells is the loop's own mistake.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from .. import filters
from ..beads import features, plan_geometry
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import Correction, CorrectionInput, Forecast
from . import net, net_file
from .bead_solver_law import BeadSolver
from .explicit import DampedInverse

NO_MODEL = 'none'  # in place of a file of weights: the base law without a network
DOUBT = 0.25  # share of the planned height: expected error at which the confidence is a half
# Share of the planned height that is acted on at most. Setpoints cannot fill a deeper hollow within a bead; a hump is
# avoided by laying less. In walls narrower than a bead, a hump that one layer leaves stands in the hollow of the next
# one, laid otherwise.
HOLLOW, HUMP, IN_WALL = 0.15, 0.4, 0.05
MAX_LEVEL = 0.1
SMOOTH = 1.5  # cells: sigma of what is acted on; shorter waves setpoints cannot make


@dataclass(frozen=True)
class UNetLaw:
    """network None: `broken` says why, and every answer announces it; without words (NO_MODEL) it is the base law.

    confidence of the result: that of the base law times 1/(1 + (sigma/DOUBT)^2), sigma told by the network.
    """

    base: BeadSolver
    network: net.Network | None
    broken: str = ''
    name: str = 'unet'

    @classmethod
    def load(cls, path: str, explicit: DampedInverse) -> UNetLaw:
        """path '' = the packaged weights, NO_MODEL = none."""
        base = BeadSolver(explicit, cls.name)
        if path == NO_MODEL:
            return cls(base, None)
        try:
            return cls(base, _model(Path(path) if path else net_file.PACKAGED))
        except net.ModelError as e:
            return cls(base, None, str(e))

    @property
    def first_weight(self) -> tuple[float, float]:
        """Of shape and level in a job that has laid nothing yet: what the laboratory's worst family earned."""
        if self.network is None:
            return 0.0, 0.0
        earned = self.network.card['weights']
        return float(earned['shape']), float(earned['level'])

    def forecast(self, request: CorrectionInput) -> Forecast:
        """What the base law would leave of this layer; nothing, with the reason, where the network cannot say.
        request: as identification prepares it."""
        grid = grid_of(request)
        zero = np.zeros(grid.shape)
        nothing = Forecast(zero, np.full(grid.shape, DOUBT), zero)
        if self.network is None or not request.paths or not request.footprint.any():
            return replace(nothing, doubt=self.broken)
        if request.of_other_planner:  # trained on plans of our own
            return nothing
        counted = features.counted(request, grid)
        x = features.build(request, grid, counted)
        if not x[0].any():
            return replace(nothing, doubt='the layer covers no cell of the bead model')
        if odd := features.unlike(x, request.bead_width, self.network.card['seen']):
            return replace(nothing, doubt=f'plan unlike the training: {odd}')
        box = plan_geometry.box(x)
        told, log_sigma = self.network(x[:, *box])
        if not (np.isfinite(told).all() and np.isfinite(log_sigma).all()):
            return replace(nothing, doubt='the network gave an answer that is not finite')
        left, sigma = zero, nothing.sigma
        left[box], sigma[box] = told, np.exp(log_sigma.astype(float))
        wide = filters.thickest(request.footprint) * request.resolution >= request.bead_width
        bounds = (-HOLLOW, HUMP) if wide else (-IN_WALL, IN_WALL)
        shape, level = parted(left, counted, bounds)
        return Forecast(shape, sigma, counted, level, self.network.digest)

    def prepare(self, request: CorrectionInput) -> None:
        """Also what the network sees of the plan."""
        self.base.prepare(request)
        if self.network is not None and not request.of_other_planner:
            plan_geometry.build(request, grid_of(request))

    def correct(self, request: CorrectionInput) -> Correction:
        """The base law's answer with the forecast of the request (`Corrector` weighs it); where there is none because
        the network cannot say, the reason and fallback."""
        forecast = request.forecast or self.forecast(request).weighed(*self.first_weight)
        result = self.base.correct(request.with_prediction(forecast))
        if result.fallback:
            return result
        if forecast.doubt:
            reason = f'{self.name}: {forecast.doubt}; the bead solver answers without the network'
            return replace(result, fallback=True, reasons=(reason, *result.reasons))
        if not forecast.digest:
            return result
        grid = grid_of(request)
        sure = np.clip(grid.fine(1 / (1 + (forecast.sigma / DOUBT) ** 2)), 0.0, 1.0)
        return replace(
            result,
            confidence=result.confidence * sure,
            model_hash=forecast.digest,
            reasons=(*result.reasons, *self._remarks(forecast)),
        )

    def _remarks(self, forecast: Forecast) -> tuple[str, ...]:
        """What the job has left the network to say, for report and record."""
        if math.isnan(forecast.weight):
            return ()
        text = f'{self.name}: weight of the network {forecast.weight:.2f}'
        return (f'{text}, level of this layer {forecast.level:+.1%}' if forecast.level else text,)


def grid_of(request: CorrectionInput) -> Resampler:
    """The network's."""
    return Resampler.of(request.z.shape, request.resolution, request.bead_width / CELLS_PER_BEAD)


def parted(
    left: np.ndarray, counted: np.ndarray, bounds: tuple[float, float]
) -> tuple[np.ndarray, float]:
    """What is left (rows, cols), parted into a smooth shape with mean 0 over the cells that count (rows, cols) and a
    level, both within their limits."""
    total = max(float(counted.sum()), 1e-9)
    level = float((left * counted).sum()) / total
    shape = (left - level) * (counted > 0)
    spread = np.maximum(gaussian_filter((counted > 0).astype(float), SMOOTH), 1e-3)
    shape = np.where(counted > 0, gaussian_filter(shape, SMOOTH) / spread, 0.0)
    shape = shape - float((shape * counted).sum()) / total
    shape = np.clip(shape, *bounds) * counted
    return shape, min(max(level, -MAX_LEVEL), MAX_LEVEL)


@lru_cache(maxsize=4)
def _model(path: Path) -> net.Network:
    """Read once per process: the weights do not change under a running job."""
    return net_file.load(path)
