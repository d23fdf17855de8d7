"""RMS error of the surface after the layer to come, with a 90 % interval. Pure.

The basis is what is known before the layer: the error of the surface now, and what the network says of its own
uncertainty. How the layers of this job came out beside their basis is followed by a scalar Kalman filter on the
logarithm, which drifts; how they scatter about it is identified from the innovations (Mehra 1970). A loop that diverges
is foretold larger and larger errors, and wider intervals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..beads.features import middle
from ..types import CorrectionInput, error_figures
from .layers import AskedLayer, Outcome, SeenLayer

Z90 = 1.645  # of a normal distribution: 90 % lie within
FIRST_SIGMA = 0.35  # of the bias, before any layer
DRIFT = 0.15  # of the bias from layer to layer
SCATTER = 0.22  # of a layer about the bias, before any layer
SCATTER_LAYERS = 3  # that this first belief counts for
KEPT = 0.6  # share of the surface's error that a layer leaves where no network says otherwise
ROUGHNESS = 0.07  # layer heights: RMS that a layer adds, the same
MIN_RMS = 1e-6  # m
MAX_INNOVATION = 1.5


def basis(error_rms: float, height: float, network_rms: float = 0.0) -> float:
    """m: RMS that is expected of any job. error_rms: of the surface now; height: of the layer; network_rms: what the
    network says that the layer will leave, all in m, 0 = it says nothing."""
    alone = math.hypot(KEPT * error_rms, ROUGHNESS * height)
    return max(math.sqrt(alone * network_rms) if network_rms > 0 else alone, MIN_RMS)


@dataclass(frozen=True)
class OutcomeForecast:
    """bias: logarithm of measured over basis in this job; variance: of it; scatter: of a layer about it."""

    bias: float = 0.0
    variance: float = FIRST_SIGMA**2
    scatter: float = SCATTER
    layers: int = 0

    def expect(self, of: float) -> Outcome:
        """of: the layer's `basis`, m."""
        middle = of * math.exp(self.bias)
        room = math.exp(Z90 * math.sqrt(self.variance + self.scatter**2))
        return Outcome(middle, middle / room, middle * room)

    def after(self, of: float, measured: float) -> OutcomeForecast:
        """With one more layer: its basis and the RMS that it left, m."""
        if not (of > 0 and math.isfinite(measured) and measured > 0):
            return self
        innovation = math.log(max(measured, MIN_RMS) / of) - self.bias
        innovation = min(max(innovation, -MAX_INNOVATION), MAX_INNOVATION)
        gain = self.variance / (self.variance + self.scatter**2)
        seen = max(innovation**2 - self.variance, 0.0)
        count = SCATTER_LAYERS + self.layers
        return replace(
            self,
            bias=self.bias + gain * innovation,
            variance=(1 - gain) * self.variance + DRIFT**2,
            scatter=math.sqrt((count * self.scatter**2 + seen) / (count + 1)),
            layers=min(self.layers + 1, 6),
        )


class OutcomeEstimator:
    """Says what will be left after each layer, by what was left after those before. The last of the estimators."""

    def __init__(self) -> None:
        # with the newest layer that was told, and its basis, m
        self.state: tuple[OutcomeForecast, int, float] = OutcomeForecast(), 0, 0.0

    def observe(self, seen: SeenLayer) -> None:
        """Nothing: the map before the next layer says it, also where too little of the growth is known."""

    def prepare(self, request: CorrectionInput, asked: AskedLayer) -> CorrectionInput:
        """The request as it is; what is expected goes into the memory of the layer."""
        left = error_figures(asked.request)[0]
        if not asked.trusted or not math.isfinite(left):
            return request
        forecast, number, of = self.state
        if number == asked.number - 1:
            forecast = forecast.after(of, left)
        height = middle(request)
        network = request.forecast.rms if request.forecast is not None else 0.0
        of = basis(left, height, height * network)
        self.state = forecast, asked.number, of
        asked.outcome = forecast.expect(of)
        return request
