"""Efficiency of the wire and exponent of height on metal, followed from layer to layer.

`evidence` says what one layer is worth, `estimate` is the filter, `path_patterns` what the pattern of a layer does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..types import CorrectionInput, with_side
from .bead_shortfall import BeadShortfall
from .estimate import Estimate, update, update_slope
from .evidence import BlockAverages, Layer, LayerEvidence, edge_sigma, layer_evidence, level
from .layers import AskedLayer, SeenLayer, model_of, model_of_request
from .path_patterns import PathPatterns


@dataclass(frozen=True)
class Process:
    """What the layers of a job have taught."""

    estimate: Estimate = Estimate()
    # of even and odd layers
    averages: tuple[BlockAverages | None, BlockAverages | None] = (None, None)
    patterns: PathPatterns = PathPatterns()
    first: LayerEvidence | None = None  # of the first layer, for the jobs to come
    layers: int = 0  # seen


class Efficiency:
    """The first of the estimators: the others read what it believes of a layer."""

    def __init__(self, beads: BeadShortfall | None, forgetting: float) -> None:
        """beads: of laws that solve for them. forgetting: see `update`."""
        self.beads, self.forgetting = beads, forgetting
        self.state = Process()

    def believed(
        self, forecast_level: float = 0.0, pattern: tuple[np.ndarray, ...] = ()
    ) -> Estimate:
        """What is believed of a layer, of whose level the network told `forecast_level`, and whose pattern is told."""
        estimate = self.state.estimate
        share = (1 + self.state.patterns.offset(pattern)) * (1 + forecast_level)
        return replace(estimate, efficiency_ratio=estimate.efficiency_ratio * share)

    def look(self, number: int, layer: Layer, asked: AskedLayer | None) -> SeenLayer | None:
        """The layer that was laid last; None when too little of it can be seen."""
        if layer.planned is None and asked is not None:
            layer = replace(layer, planned=asked.request.planned)
        paths = asked.request.paths if asked else ()
        model = model_of(paths, layer.before.shape, layer.resolution, layer.bead_width)
        evidence = layer_evidence(layer, self.state.estimate.slope_on(model))
        return None if evidence is None else SeenLayer(number, layer, evidence, model, asked)

    def observe(self, seen: SeenLayer) -> None:
        """Ratio and exponent with one more layer."""
        number, state = seen.number, self.state
        told = seen.asked.forecast_level if seen.asked else 0.0
        pattern = seen.asked.pattern if seen.asked else ()
        seen.laid_with = self.believed(told, pattern)
        ratio, sigma = self._ratio(seen) / (1 + told), seen.evidence.ratio_sigma
        doubt = math.hypot(sigma, edge_sigma(seen.layer))
        patterns = self._patterns(pattern, ratio, doubt)
        ratio /= 1 + patterns.offset(pattern)
        evidence = replace(seen.evidence, ratio=ratio, ratio_sigma=doubt)
        estimate = update(state.estimate, evidence, self.forgetting)
        average = state.averages[number % 2]
        if average is not None:
            estimate = update_slope(estimate, *average.slope(seen.evidence))
        after = BlockAverages.after(average, seen.evidence)
        self.state = Process(
            estimate=estimate,
            averages=with_side(state.averages, number % 2, after),
            patterns=patterns,
            first=replace(evidence, ratio_sigma=sigma) if number == 1 else state.first,
            layers=state.layers + 1,
        )
        seen.process = estimate

    def _ratio(self, seen: SeenLayer) -> float:
        """Of growth to command. Where the beads are known it is the mean, beside what they were known to lack: the
        median says what most blocks do, and leaves the level off."""
        if self.beads is None or seen.model is None:
            return seen.evidence.ratio
        layer, model, beads = seen.layer, seen.model, self.beads.state
        plan = layer.commanded if layer.planned is None else layer.planned
        found = level(
            model,
            layer.after - layer.before,
            plan,
            layer.commanded,
            layer.resolution,
            self.state.estimate.slope_on(model),
            beads.lag * model.width,
            beads.of(seen.number, model),
        )
        return seen.evidence.ratio if found is None else found

    def _patterns(
        self, pattern: tuple[np.ndarray, ...], ratio: float, sigma: float
    ) -> PathPatterns:
        """With the share of the layer's pattern in what it shows."""
        estimate = self.state.estimate
        expected = self.believed(pattern=pattern).efficiency_ratio
        variance = estimate.efficiency_sigma**2 + sigma**2 + estimate.layer_noise**2
        return self.state.patterns.learn(pattern, ratio / expected - 1, variance)

    def prepare(self, request: CorrectionInput, asked: AskedLayer) -> CorrectionInput:
        """The request as a law for overlapped beads must see it, in terms of metal.

        Growth goes with metal to the power `slope`; where that is below 1 (a wall gets wider as well), more metal has
        to be asked for than is missing. The slope is taken cautiously, one sigma towards 1: too large an answer swings.
        """
        estimate = self.state.estimate
        asked.process, asked.layers_seen = estimate, self.state.layers
        slope = estimate.slope_on(model_of_request(request), estimate.slope_sigma)
        if slope >= 1.0:
            return request
        return replace(request, target=request.z + request.error / slope)

    def flow_factor(self, request: CorrectionInput, asked: AskedLayer | None) -> float:
        """Of the layer that the request is for. What eq 2.19 will take off its feed is put back: how high the beads
        come out is decided by what the scans show. The share of a pattern is not asked for: most of it is lost at rims.
        """
        slope = self.state.estimate.slope_on(model_of_request(request))
        level_told = asked.forecast_level if asked else 0.0
        return self.believed(level_told).flow_factor(slope) / request.heat_factor
