"""What the layers teach about the process: efficiency, exponent of height on metal, what beads lack, and how far the
network's forecast is to be trusted.

`estimate` follows efficiency and exponent from layer to layer, `evidence` says what one layer is worth,
`beads.bead_bias` learns what beads lack at the same place again and again, `kinds` what is due to the pattern of a
layer, `forecast_weight` weighs the forecast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from ..beads.bead_bias import BeadBias
from ..beads.features import known_mean, middle
from ..beads.model import MARGIN, BeadModel, bead_model, inner_mean
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import BeadDeviation, CorrectionInput, Forecast, with_side
from .estimate import Estimate, update, update_slope
from .evidence import (
    MIN_GROWTH,
    BlockAverages,
    Layer,
    LayerEvidence,
    edge_sigma,
    layer_evidence,
)
from .forecast_weight import ForecastWeight
from .kinds import Kinds
from .level import level
from .outcome import Outcome, OutcomeForecast, basis


@dataclass(frozen=True)
class Start:
    """What is believed before the first layer of a job."""

    estimate: Estimate = Estimate()
    beads: BeadBias = BeadBias()
    shape_weight: ForecastWeight = ForecastWeight(0.0)
    level_weight: ForecastWeight = ForecastWeight(0.0)


@dataclass(frozen=True)
class Learned(Start):
    """What the layers of a job have taught."""

    # of even and odd layers
    averages: tuple[BlockAverages | None, BlockAverages | None] = (None, None)
    kinds: Kinds = Kinds()  # of layers, by the pattern of their paths
    outcomes: OutcomeForecast = OutcomeForecast()


class _Asked(NamedTuple):
    """A layer as it was asked for: metal of the plan (rows, cols) m, its beads, the surface that it was to end with
    (rows, cols) m, and what the network told, unweighed and weighed."""

    planned: np.ndarray
    paths: tuple[np.ndarray, ...]
    wanted: np.ndarray
    told: Forecast | None = None
    weighed: Forecast | None = None
    basis: float = 0.0  # m, of `outcome`


@dataclass
class Identifier:
    """Keeps what one job has taught; asking twice for the same layer does not count its evidence twice."""

    forgetting: float = 0.3  # see `update`
    learning: float = 0.3  # 0..1, of what beads lack; 0 = never
    watch_beads: bool = False  # by the bead model (`beads.bead_bias`), for laws that use it
    job_id: str = ''
    layer: int = 0
    estimate: Estimate = Estimate()
    beads: BeadBias = BeadBias()
    shape_weight: ForecastWeight = ForecastWeight(0.0)
    level_weight: ForecastWeight = ForecastWeight(0.0)
    # of even and odd layers
    averages: tuple[BlockAverages | None, BlockAverages | None] = (None, None)
    kinds: Kinds = Kinds()  # of layers, by the pattern of their paths
    outcomes: OutcomeForecast = OutcomeForecast()
    asked: dict[int, _Asked] = field(default_factory=dict)  # the newest layers
    seen: dict[int, LayerEvidence] = field(default_factory=dict)  # of all layers of the job
    by_pattern: bool = False  # the layers of this job are told apart so: those of another planner
    _before: Learned = Learned()  # as of the begin of this layer

    def start(self, job_id: str, layer: int, first: Start | None = None) -> None:
        """Call before every layer: forgets another job's process, repeats a layer from where it began. first: what a
        job begins with, None = as one of which nothing is known."""
        if job_id != self.job_id or layer < self.layer:
            self._before = Learned(**vars(first or Start()))
            self.seen = {}
            self.asked = {}  # those layers do not lie below
        elif layer > self.layer:
            self._before = Learned(**{f.name: getattr(self, f.name) for f in fields(Learned)})
        self.job_id, self.layer = job_id, layer
        for f in fields(Learned):
            setattr(self, f.name, getattr(self._before, f.name))

    def add(self, layer: Layer) -> None:
        """Learns from the layer that was laid last, if enough of it can be seen."""
        number = self.layer - 1
        asked = self.asked.get(number)
        if layer.planned is None and asked is not None:
            layer = replace(layer, planned=asked.planned)
        model = self._model_laid(number, layer)
        slope = self.slope_of(model)
        evidence = layer_evidence(layer, slope)
        if evidence is None:
            return
        seen_level = self._level(number, model, layer) if self.watch_beads and model else None
        seen = evidence
        # Where the beads are known, the mean alone: the median says what most blocks do, and leaves the level off.
        if seen_level is not None:
            seen = replace(evidence, ratio=seen_level)
        told = self._level_told(number)
        before = self._believed(told, number)
        doubt = math.hypot(seen.ratio_sigma, edge_sigma(layer))
        seen = replace(seen, ratio=seen.ratio / (1 + told), ratio_sigma=doubt)
        seen = self._without_kind(number, seen)
        self.estimate = update(self.estimate, seen, self.forgetting)
        side = number % 2
        average = self.averages[side]
        if average is not None:
            self.estimate = update_slope(self.estimate, *average.slope(evidence))
        after = BlockAverages.after(average, evidence)
        self.averages = with_side(self.averages, side, after)
        self.seen[number] = replace(evidence, ratio=seen.ratio)  # as the estimate was told
        self._weigh_forecast(number, layer)
        if self.learning > 0 and self.watch_beads and model is not None:
            self._learn_beads(number, model, layer, before)

    def _pattern_of(self, number: int) -> tuple[np.ndarray, ...]:
        """The beads whose pattern tells the kind of layer `number`; none where kinds are not told apart."""
        return self.asked[number].paths if self.by_pattern and number in self.asked else ()

    def _level_told(self, number: int) -> float:
        """By which share of its height layer `number` was told to end too high, as it was believed."""
        asked = self.asked.get(number)
        return asked.weighed.level if asked is not None and asked.weighed is not None else 0.0

    def _believed(self, told: float = 0.0, number: int = 0) -> Estimate:
        """What is believed of a layer, of whose level the network told `told`; number: with the share of the pattern of
        that layer, 0 = without."""
        share = (1 + self.kinds.offset(self._pattern_of(number))) * (1 + told)
        return replace(self.estimate, efficiency_ratio=self.estimate.efficiency_ratio * share)

    def _without_kind(self, number: int, seen: LayerEvidence) -> LayerEvidence:
        """Evidence of the process alone: what is due to the pattern of the layer is learned and taken off."""
        paths, believed = self._pattern_of(number), self.estimate
        expected = self._believed(number=number).efficiency_ratio
        variance = believed.efficiency_sigma**2 + seen.ratio_sigma**2 + believed.layer_noise**2
        self.kinds = self.kinds.learn(paths, seen.ratio / expected - 1, variance)
        return replace(seen, ratio=seen.ratio / (1 + self.kinds.offset(paths)))

    def _level(self, number: int, model: BeadModel, layer: Layer) -> float | None:
        """Of layer `number`, beside what its beads were known to lack; None when too little of it is known."""
        plan = layer.commanded if layer.planned is None else layer.planned
        return level(
            model,
            layer.after - layer.before,
            plan,
            layer.commanded,
            layer.resolution,
            self.slope_of(model),
            self.beads.lag * model.width,
            self.beads.of(number, model),
        )

    def _learn_beads(self, number: int, model: BeadModel, layer: Layer, before: Estimate) -> None:
        """Learns what the bead model did not predict of a layer whose paths are known. before: estimate that the layer
        was laid with."""
        grid = Resampler.of(layer.before.shape, layer.resolution, layer.bead_width / CELLS_PER_BEAD)
        laid = np.where(layer.footprint, layer.commanded, np.nan)
        plan = laid if layer.planned is None else layer.planned
        plan = np.where(plan > MIN_GROWTH, plan, np.nan)
        slope = self.slope_of(model)
        asked = model.of_cells(laid / plan, layer.resolution) ** slope
        allowed = before.flow_factor(slope) ** -slope if before.updates >= 2 else None
        growth = (layer.after - layer.before) / plan
        footprint, margin = np.isfinite(laid), MARGIN * layer.bead_width / layer.resolution
        known = footprint & np.isfinite(growth)
        growth, seen = inner_mean(growth, known, footprint, grid, margin)
        height, _ = known_mean(plan, grid)
        self.beads = self.beads.learn(
            number, model, asked, growth, seen, self.learning, allowed=allowed, height=height
        )

    def _weigh_forecast(self, number: int, layer: Layer) -> None:
        """Shape and level of the forecast against what the base law would have left of the layer."""
        asked = self.asked.get(number)
        if asked is None or asked.told is None or asked.weighed is None:
            return
        told, weighed = asked.told, asked.weighed
        grid = Resampler.of(layer.before.shape, layer.resolution, layer.bead_width / CELLS_PER_BEAD)
        height = float(np.median(asked.planned[np.nan_to_num(asked.planned) > MIN_GROWTH]))
        left, known = known_mean((layer.after - asked.wanted) / height, grid)
        use = np.where(known, told.counted, 0.0)
        if use.sum() <= 0:
            return
        self.shape_weight = self.shape_weight.after_shape(told.shape, left + weighed.shape, use)
        mean = float((np.where(use > 0, left, 0.0) * use).sum() / use.sum())
        self.level_weight = self.level_weight.after_level(
            told.level, mean + weighed.level, self.estimate.layer_noise
        )

    def outcome(self, error_rms: float, request: CorrectionInput) -> Outcome:
        """RMS of the surface after the layer that `prepare` was called for. error_rms: m, of the surface before it, by
        which the forecast of the layer before is judged; request: as the law answers it."""
        before = self.asked.get(self.layer - 1)
        if before is not None and before.basis > 0:
            self.outcomes = self.outcomes.after(before.basis, error_rms)
        height = middle(request)
        told = request.forecast.rms if request.forecast is not None else 0.0
        of = basis(error_rms, height, height * told)
        self.asked[self.layer] = self.asked[self.layer]._replace(basis=of)
        return self.outcomes.expect(of)

    def prepare(self, request: CorrectionInput) -> CorrectionInput:
        """The request as a law for overlapped beads must see it: with what its beads lack, in terms of metal.

        Growth goes with metal to the power `slope`; where that is below 1 (a wall gets wider as well), more metal has
        to be asked for than is missing. The slope is taken cautiously, one sigma towards 1: too large an answer swings.
        """
        wanted = request.target + np.nan_to_num(request.planned)
        self.asked = {n: a for n, a in self.asked.items() if n == self.layer - 1}
        self.asked[self.layer] = _Asked(request.planned, request.paths, wanted)
        self.by_pattern = request.of_other_planner
        model = self.model_of(request)
        slope = self.slope_of(model, self.estimate.slope_sigma)
        if self.watch_beads and model is not None:
            request = request.told(learned=self._beads_of(request, model, slope))
        if slope >= 1.0:
            return request
        return replace(request, target=request.z + request.error / slope)

    def weigh(self, told: Forecast) -> Forecast:
        """The forecast of the layer that `prepare` was called for, as far as this job believes it; remembered, so that
        the next layer can judge it."""
        shape, of_level = self.shape_weight.weight, self.level_weight.weight
        weighed = told.weighed(shape, of_level)
        if told.digest:
            self.estimate = replace(self.estimate, network_weight=shape)
            self.asked[self.layer] = self.asked[self.layer]._replace(told=told, weighed=weighed)
        return weighed

    def _beads_of(self, request: CorrectionInput, model: BeadModel, slope: float) -> BeadDeviation:
        beads = self.beads
        return BeadDeviation(
            missing=beads.of(self.layer, model) - beads.surplus,
            lag=beads.lag * request.bead_width,
            slope=slope,
            scale=slope,
            fill=beads.fill,
            layers=len(self.seen),
            scatter=self.estimate.layer_noise,
            response=beads.response,
        )

    def flow_factor(self, request: CorrectionInput) -> float:
        """Of the layer that the request is for. What eq 2.19 will take off its feed is put back: how high the beads
        come out is decided by what the scans show. The share of a pattern is not asked for: most of it is lost at rims.
        """
        slope = self.slope_of(self.model_of(request))
        believed = self._believed(self._level_told(self.layer))
        return believed.flow_factor(slope) / request.heat_factor

    def model_of(self, request: CorrectionInput) -> BeadModel | None:
        """Of the layer that the request is for; None when its beads are not told."""
        return self._of_paths(
            request.paths, request.z.shape, request.resolution, request.bead_width
        )

    def _model_laid(self, number: int, layer: Layer) -> BeadModel | None:
        """Of a layer that was laid; None when its beads were not told."""
        paths = self.asked[number].paths if number in self.asked else ()
        return self._of_paths(paths, layer.before.shape, layer.resolution, layer.bead_width)

    @staticmethod
    def _of_paths(
        paths: tuple[np.ndarray, ...], shape: tuple[int, int], resolution: float, width: float
    ) -> BeadModel | None:
        if not paths:
            return None
        rows, cols = shape
        grid = Resampler.of((rows, cols), resolution, width / CELLS_PER_BEAD)
        return bead_model(paths, grid.shape, width)

    def slope_of(self, model: BeadModel | None, caution: float = 0.0) -> float:
        """Of growth on metal: overlapped beads keep all of it, a single one gets wider as well. caution: added to what
        was estimated where nothing says that the beads overlap."""
        if model is not None and model.overlapped:
            return 1.0
        return min(1.0, self.estimate.slope + caution)
