"""Weight of a forecast in a job, by what it would have left of the layers that the job has laid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
