"""What the layers teach about the process: a list of estimators over one memory of layers.

Every estimator has a `state` that is never changed but replaced, `observe(layer)` for a layer that was laid, and
`prepare(request)` for the next one. They are asked in order; what one finds, the ones after it read in the layer's
memory (`layers`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from waam_process.learned import Learned, Taught

from ..types import CorrectionInput, Forecast
from .bead_shortfall import BeadShortfall
from .efficiency import Efficiency, Process
from .estimate import Estimate
from .evidence import Layer
from .forecast_weight import ForecastTrust, ForecastWeights
from .layers import AskedLayer, SeenLayer
from .outcome import OutcomeEstimator

FORGETTING = 0.3  # of the efficiency ratio, see `estimate.update`


class Estimator(Protocol):
    """One thing that is learned of a job."""

    state: Any

    def observe(self, seen: SeenLayer) -> None:
        """With one more layer that was laid."""

    def prepare(self, request: CorrectionInput, asked: AskedLayer) -> CorrectionInput:
        """The request with what is believed of its layer, which is also left in the layer's memory."""


@dataclass(frozen=True)
class Start:
    """What is believed before the first layer of a job."""

    estimate: Estimate = Estimate()
    forecast: ForecastWeights = ForecastWeights()

    @classmethod
    def of(cls, learned: Learned | None, forecast: ForecastWeights = ForecastWeights()) -> Start:
        """learned: by former jobs, None = nothing is known of them."""
        if learned is None or not learned.jobs:
            return cls(forecast=forecast)
        estimate = Estimate(
            efficiency_ratio=learned.efficiency, efficiency_sigma=learned.efficiency_sigma
        )
        return cls(estimate, forecast)


class Identifier:
    """Keeps what one job has taught; asking twice for the same layer does not count its evidence twice."""

    def __init__(
        self,
        learning: float = 0.3,
        watch_beads: bool = False,
        forecast: Callable[[CorrectionInput], Forecast] | None = None,
    ) -> None:
        """learning: 0..1, of what beads lack; 0 = never. watch_beads: by the bead model, for laws that use it.
        forecast: of the law's network, None = it has none."""
        self.beads = BeadShortfall(learning) if watch_beads else None
        self.efficiency = Efficiency(self.beads, FORGETTING)
        self.forecasts = ForecastTrust(forecast) if forecast else None
        found = (self.efficiency, self.beads, self.forecasts, OutcomeEstimator())
        self.estimators: list[Estimator] = [e for e in found if e is not None]
        self.job_id, self.layer = '', 0
        self.memory: dict[int, AskedLayer] = {}  # the newest layers
        self._fresh = self._before = self._states()  # of a job that begins; before this layer

    def _states(self) -> list[Any]:
        return [e.state for e in self.estimators]

    def start(self, job_id: str, layer: int, first: Start = Start()) -> None:
        """Call before every layer: forgets another job's process, repeats a layer from where it began. first: what a
        job begins with."""
        if job_id != self.job_id or layer < self.layer:
            self._set(self._fresh)
            self.efficiency.state = Process(first.estimate)
            if self.forecasts:
                self.forecasts.state = first.forecast
            self._before = self._states()
            self.memory = {}  # those layers do not lie below
        elif layer > self.layer:
            self._before = self._states()
        self.job_id, self.layer = job_id, layer
        self.memory.pop(layer, None)
        self._set(self._before)

    def _set(self, states: list[Any]) -> None:
        for estimator, state in zip(self.estimators, states, strict=True):
            estimator.state = state

    def add(self, layer: Layer) -> None:
        """Learns from the layer that was laid last, if enough of it can be seen."""
        number = self.layer - 1
        seen = self.efficiency.look(number, layer, self.memory.get(number))
        if seen is not None:
            for estimator in self.estimators:
                estimator.observe(seen)

    def prepare(self, request: CorrectionInput, trusted: bool = True) -> CorrectionInput:
        """The request as its law must see it. trusted: its map may be used."""
        asked = AskedLayer(self.layer, request, trusted)
        self.memory = {n: a for n, a in self.memory.items() if n == self.layer - 1}
        self.memory[self.layer] = asked
        for estimator in self.estimators:
            request = estimator.prepare(request, asked)
        return request

    @property
    def estimate(self) -> Estimate:
        """What is believed of the process, and of the network in the layer to come."""
        asked = self.memory.get(self.layer)
        return asked.process if asked else self.efficiency.state.estimate

    def flow_factor(self, request: CorrectionInput) -> float:
        """Of the wire feed of the layer to come."""
        return self.efficiency.flow_factor(request, self.memory.get(self.layer))

    def taught(self) -> Taught | None:
        """What the layers of the job so far have shown; None before the first layer was seen. The efficiency is that of
        the first layer: later ones are laid on a warmer part, and the estimate follows them by itself."""
        process = self.efficiency.state
        if process.first is None:
            return None
        sigma = float(np.hypot(process.first.ratio_sigma, process.estimate.layer_noise))
        return Taught(efficiency=process.first.ratio, efficiency_sigma=sigma, layers=process.layers)
