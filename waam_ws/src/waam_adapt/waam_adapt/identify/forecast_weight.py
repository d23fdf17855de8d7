"""Weight of a forecast in a job, by what it would have left of the layers that the job has laid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..beads.features import known_mean
from ..types import CorrectionInput, Forecast
from .evidence import MIN_GROWTH
from .layers import AskedLayer, SeenLayer, grid_of

START_SIGMA = 0.25  # of the weight before any layer was seen
LAYER_SCATTER = 0.25  # of the slope of a single layer about that of its job
FORGETTING = 0.9  # per layer
NOISE_CORRELATION_CELLS = 4.0  # neighbouring cells whose noise is one
MIN_CELLS = 10.0
MIN_FORECAST = 0.01  # RMS share of the planned height; smaller forecasts say nothing
MAX_ERROR = 0.6  # layer heights that a cell counts at most


@dataclass(frozen=True)
class ForecastWeight:
    """weight: 0..1, of what is forecast of the next layer. A scalar Kalman filter on the slopes of what the base law
    would have left on what was forecast: a forecast that halves the rest keeps its weight, one that is wrong loses it,
    and one that is too timid gains it."""

    weight: float
    information: float = START_SIGMA**-2  # 1/variance of the weight

    def after_shape(
        self, forecast: np.ndarray, left: np.ndarray, counted: np.ndarray
    ) -> ForecastWeight:
        """With one more layer. forecast (rows, cols): share of the planned height, unweighted; left (rows, cols): what
        the base law would have left; counted (rows, cols): weight of a cell, 0 = unknown. Means are taken off."""
        if counted.sum() < MIN_CELLS:
            return self
        w = counted / counted.sum()
        left = np.clip(np.where(counted > 0, left, 0.0), -MAX_ERROR, MAX_ERROR)
        x, y = (v - float((w * v).sum()) for v in (forecast, left))
        sxx, sxy = float((w * x * x).sum()), float((w * x * y).sum())
        if sxx < MIN_FORECAST**2:
            return self
        slope = sxy / sxx
        rest = float((w * (y - slope * x) ** 2).sum())
        noise = NOISE_CORRELATION_CELLS * rest / (float(counted.sum()) * sxx) + LAYER_SCATTER**2
        return self._with(slope, noise)

    def after_level(self, forecast: float, left: float, scatter: float) -> ForecastWeight:
        """With one more layer. forecast, left: of the whole layer, as shares of its height; scatter: standard deviation
        of a layer's level."""
        if abs(forecast) < 1e-4:
            return self
        return self._with(left / forecast, (scatter / forecast) ** 2)

    def _with(self, slope: float, noise: float) -> ForecastWeight:
        known = FORGETTING * self.information
        information = known + 1 / noise
        weight = (known * self.weight + slope / noise) / information
        return ForecastWeight(min(max(weight, 0.0), 1.0), information)


@dataclass(frozen=True)
class ForecastWeights:
    """Of shape and level."""

    shape: ForecastWeight = ForecastWeight(0.0)
    level: ForecastWeight = ForecastWeight(0.0)


class ForecastTrust:
    """Weighs what the network forecasts of each layer by what came of the ones before. forecast: asks the network."""

    def __init__(self, forecast: Callable[[CorrectionInput], Forecast]) -> None:
        self.forecast = forecast
        self.state = ForecastWeights()

    def observe(self, seen: SeenLayer) -> None:
        """Shape and level of the forecast against what the base law would have left of the layer."""
        asked, layer = seen.asked, seen.layer
        if asked is None or asked.forecast is None or asked.weighed is None:
            return
        told, weighed, planned = asked.forecast, asked.weighed, asked.request.planned
        grid = grid_of(layer.before.shape, layer.resolution, layer.bead_width)
        height = float(np.median(planned[np.nan_to_num(planned) > MIN_GROWTH]))
        left, known = known_mean((layer.after - asked.wanted) / height, grid)
        use = np.where(known, told.counted, 0.0)
        if use.sum() <= 0:
            return
        mean = float((np.where(use > 0, left, 0.0) * use).sum() / use.sum())
        self.state = ForecastWeights(
            self.state.shape.after_shape(told.shape, left + weighed.shape, use),
            self.state.level.after_level(
                told.level, mean + weighed.level, seen.process.layer_noise
            ),
        )

    def prepare(self, request: CorrectionInput, asked: AskedLayer) -> CorrectionInput:
        """With the forecast, as far as this job believes it; nothing of a map that is not trusted."""
        if not asked.trusted:
            return request
        told, shape = self.forecast(request), self.state.shape.weight
        weighed = told.weighed(shape, self.state.level.weight)
        if told.digest:
            asked.process = replace(asked.process, network_weight=shape)
            asked.forecast, asked.weighed = told, weighed
        return request.with_prediction(forecast=weighed)
