"""What the layers teach about the process: efficiency, exponent of height on metal, spread, what is always missing.

`estimate` follows efficiency and exponent from layer to layer, `evidence` says what one layer is worth, `shortfall`
learns what layers miss at the same place again and again, `kinds` what is due to the pattern of a layer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from ..beads import alignment
from ..beads.bead_bias import BeadBias
from ..beads.model import MARGIN, BeadModel, bead_model, inner_mean
from ..beads.residual import FAR, LEAST, known_mean
from ..beads.skill import Beside, Skill, beside_model
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import BeadDeviation, CorrectionInput, with_side
from .estimate import Estimate, update, update_slope
from .evidence import (
    MIN_GROWTH,
    BlockAverages,
    Layer,
    LayerEvidence,
    edge_sigma,
    layer_evidence,
    response,
)
from .kinds import Kinds
from .level import level
from .shortfall import Shortfall


@dataclass(frozen=True)
class Start:
    """What is believed before the first layer of a job."""

    estimate: Estimate = Estimate()
    beads: BeadBias = BeadBias()
    skill: Skill = Skill()


@dataclass(frozen=True)
class Learned(Start):
    """What the layers of a job have taught."""

    shortfall: Shortfall = Shortfall()
    # of even and odd layers
    averages: tuple[BlockAverages | None, BlockAverages | None] = (None, None)
    kinds: Kinds = Kinds()  # of layers, by the pattern of their paths
    # what the beads do beside what the network foretells, for its side of the comparison with `beads` alone
    beads_told: BeadBias = BeadBias()
    left_skill: Skill = Skill()  # of what the network says that the loop leaves


class _Left(NamedTuple):
    """What the network said that the loop leaves of a layer (on the model's grid, unweighed), the weight that it was
    believed with, the surface that the layer was planned to end with (rows, cols) m, and the share of the planned
    height by which it was asked to stay below."""

    told: np.ndarray
    weight: float
    wanted: np.ndarray
    headroom: np.ndarray | float


@dataclass
class Identifier:
    """Keeps what one job has taught; asking twice for the same layer does not count its evidence twice."""

    forgetting: float = 0.3  # see `update`
    learning: float = 0.3  # 0..1, of the shortfall; 0 = never
    watch_beads: bool = False  # also by the bead model (`beads.bead_bias`), for laws that use it
    job_id: str = ''
    layer: int = 0
    estimate: Estimate = Estimate()
    shortfall: Shortfall = Shortfall()
    # of even and odd layers
    averages: tuple[BlockAverages | None, BlockAverages | None] = (None, None)
    beads: BeadBias = BeadBias()
    planned: dict[int, np.ndarray] = field(default_factory=dict)  # maps of the newest layers
    paths: dict[int, tuple[np.ndarray, ...]] = field(default_factory=dict)  # of the same
    beads_told: BeadBias = BeadBias()  # beside what the network foretells
    skill: Skill = Skill()
    # growth that the network told of the same, unweighed
    predicted: dict[int, np.ndarray] = field(default_factory=dict)
    levels: dict[int, float] = field(default_factory=dict)  # that it told of the same, weighed
    left_skill: Skill = Skill()
    left: dict[int, _Left] = field(default_factory=dict)  # of the same layers
    seen: dict[int, LayerEvidence] = field(default_factory=dict)  # of all layers of the job
    kinds: Kinds = Kinds()  # of layers, by the pattern of their paths
    by_pattern: bool = False  # the layers of this job are told apart so: those of another planner
    _before: Learned = Learned()  # as of the begin of this layer

    def start(self, job_id: str, layer: int, first: Start | None = None) -> None:
        """Call before every layer: forgets another job's process, repeats a layer from where it began. first: what a
        job begins with, None = as one of which nothing is known."""
        if job_id != self.job_id or layer < self.layer:
            self._before = Learned(**vars(first or Start()))
            self.seen = {}
            for kept in (self.planned, self.paths, self.predicted, self.levels, self.left):
                kept.clear()  # those layers do not lie below
        elif layer > self.layer:
            self._before = Learned(**{f.name: getattr(self, f.name) for f in fields(Learned)})
        self.job_id, self.layer = job_id, layer
        for f in fields(Learned):
            setattr(self, f.name, getattr(self._before, f.name))

    def add(self, layer: Layer) -> None:
        """Learns from the layer that was laid last, if enough of it can be seen."""
        number = self.layer - 1
        if layer.planned is None and number in self.planned:
            layer = replace(layer, planned=self.planned[number])
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
        told = self.levels.get(number, 0.0)
        before = self._believed(told, number)
        doubt = math.hypot(seen.ratio_sigma, edge_sigma(layer))
        seen = replace(seen, ratio=seen.ratio / math.exp(told), ratio_sigma=doubt)
        seen = self._without_kind(number, seen)
        self.estimate = update(self.estimate, seen, self.forgetting)
        side = number % 2
        average = self.averages[side]
        if average is not None:
            self.estimate = update_slope(self.estimate, *average.slope(evidence))
        after = BlockAverages.after(average, evidence)
        self.averages = with_side(self.averages, side, after)
        self.seen[number] = replace(evidence, ratio=seen.ratio)  # as the estimate was told
        if self.learning > 0:
            laid = np.where(layer.footprint, layer.commanded, np.nan)
            plan = laid if layer.planned is None else layer.planned
            expected = evidence.ratio * response(laid, plan, slope)
            missing = 1 - (layer.after - layer.before) / expected
            smooth = 0.25 * layer.bead_width / layer.resolution
            self.shortfall = self.shortfall.learn(number, missing, self.learning, smooth)
            if self.watch_beads and model is not None:
                self._learn_beads(number, model, layer, laid, plan, before)

    def _pattern_of(self, number: int) -> tuple[np.ndarray, ...]:
        """The beads whose pattern tells the kind of layer `number`; none where kinds are not told apart."""
        return self.paths.get(number, ()) if self.by_pattern else ()

    def _believed(self, told: float = 0.0, number: int = 0) -> Estimate:
        """What is believed of a layer, of whose level the network told `told`; number: with the share of the pattern of
        that layer, 0 = without."""
        share = (1 + self.kinds.offset(self._pattern_of(number))) * math.exp(told)
        return replace(self.estimate, efficiency_ratio=self.estimate.efficiency_ratio * share)

    def _told(self, request: CorrectionInput) -> float:
        """Level that the network tells of the request's layer, by its weight in this job; 0 where it tells none."""
        found = request.predicted
        return self.skill.weight * found.level if found is not None and found.digest else 0.0

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
        missing = self.beads.of(number, model)
        if (predicted := self.predicted.get(number)) is not None:
            with_it = self.beads_told.of(number, model) - predicted
            missing = missing + self.skill.weight * (with_it - missing)
        return level(
            model,
            layer.after - layer.before,
            plan,
            layer.commanded,
            layer.resolution,
            self.slope_of(model),
            self.beads.lag * model.width,
            missing,
        )

    def _learn_beads(
        self,
        number: int,
        model: BeadModel,
        layer: Layer,
        laid: np.ndarray,
        plan: np.ndarray,
        before: Estimate,
    ) -> None:
        """Learns what the bead model did not predict of a layer whose paths are known.

        laid: (rows, cols) m, command, NaN outside; plan: (rows, cols) m; before: estimate that the layer was laid with.
        """
        grid = Resampler.of(laid.shape, layer.resolution, layer.bead_width / CELLS_PER_BEAD)
        plan = np.where(plan > MIN_GROWTH, plan, np.nan)
        relative = laid / plan
        slope = self.slope_of(model)
        asked = model.of_cells(relative, layer.resolution) ** slope
        allowed = before.flow_factor(slope) ** -slope if before.updates >= 2 else None
        growth = (layer.after - layer.before) / plan
        footprint, margin = np.isfinite(laid), MARGIN * layer.bead_width / layer.resolution
        known = footprint & np.isfinite(growth)
        growth, seen = inner_mean(growth, known, footprint, grid, margin)
        self._judge_left(number, layer, plan, grid, seen)
        predicted = self.predicted.get(number, np.zeros(growth.shape))
        found = beside_model(model, asked, growth, seen, self.beads.lag)
        if found is not None and number in self.predicted:
            alone = self.beads.of(number, model)
            with_it = self.beads_told.of(number, model) - predicted
            self.skill = self.skill.learn(
                alone - with_it, found._replace(growth=found.growth + alone)
            )
        height, _ = known_mean(plan, grid)
        self.beads, self.beads_told = (
            beads.learn(
                number, model, asked, grown, seen,
                learning=self.learning, allowed=allowed, height=height,
            )
            for beads, grown in ((self.beads, growth), (self.beads_told, growth - predicted))
        )  # fmt: skip

    def _judge_left(
        self, number: int, layer: Layer, plan: np.ndarray, grid: Resampler, seen: np.ndarray
    ) -> None:
        """Earns what the loop was said to leave its weight: what is left, and what was taken off for it, on what was
        told. plan: (rows, cols) m, NaN where there is none; seen: share of the cells that is known."""
        if number not in self.left:
            return
        told, weight, wanted, headroom = self.left[number]
        error, known = known_mean((layer.after - wanted) / np.nanmedian(plan), grid)
        error = error + headroom
        counted = np.where(known & (told != 0), seen, 0.0)
        if counted.sum() < LEAST:
            return
        error = np.clip(np.where(counted > 0, error, 0.0), -FAR, FAR)
        self.left_skill = self.left_skill.learn(told, Beside(error + weight * told, counted))

    def prepare(self, request: CorrectionInput) -> CorrectionInput:
        """The request as a law for overlapped beads must see it: with the shortfall, in terms of metal.

        Growth goes with metal to the power `slope`; where that is below 1 (a wall gets wider as well), more metal has
        to be asked for than is missing. The slope is taken cautiously, one sigma towards 1: too large an answer swings.
        """
        self.planned = {n: p for n, p in self.planned.items() if n >= self.layer - 1}
        self.paths = {n: p for n, p in self.paths.items() if n >= self.layer - 1}
        self.predicted = {n: g for n, g in self.predicted.items() if n == self.layer - 1}
        self.levels = {n: v for n, v in self.levels.items() if n == self.layer - 1}
        self.planned[self.layer], self.paths[self.layer] = request.planned, request.paths
        self.by_pattern = request.of_other_planner
        self.levels[self.layer] = self._told(request)
        self.left = {n: v for n, v in self.left.items() if n == self.layer - 1}
        if request.predicted is not None and request.predicted.digest:
            found, weight = request.predicted, self.left_skill.weight
            self.predicted[self.layer] = found.growth
            if isinstance(found.left, np.ndarray):
                wanted = request.target + np.nan_to_num(request.planned)
                room = self.skill.weight * found.headroom
                self.left[self.layer] = _Left(found.left, weight, wanted, room)
            request = request.told(found.weighed(self.skill.weight, weight))
            self.estimate = replace(self.estimate, network_weight=self.skill.weight)
        learned = self.shortfall
        request = request.expecting(learned.share(self.layer), learned.layers[self.layer % 2])
        model = self.model_of(request)
        slope = self.slope_of(model, self.estimate.slope_sigma)
        if self.watch_beads and model is not None:
            request = request.told(learned=self._beads_of(request, model, slope))
        if slope >= 1.0:
            return request
        return replace(request, target=request.z + request.error / slope)

    def _beads_of(self, request: CorrectionInput, model: BeadModel, slope: float) -> BeadDeviation:
        lag = self.beads.lag * request.bead_width
        missing = self.beads.wanted(self.layer, model)
        if self.layer in self.predicted:
            with_it = self.beads_told.wanted(self.layer, model)
            missing = missing + self.skill.weight * (with_it - missing)
        missing = missing - self.beads.surplus
        factor = self._gain_factor(request, model)
        beads = self.beads
        return BeadDeviation(missing, lag, slope, slope, factor, beads.fill)

    def _gain_factor(self, request: CorrectionInput, model: BeadModel) -> float:
        """By how the passes lie on those below; 1 where there are none, in single beads, and in programs of others,
        whose patterns change from layer to layer."""
        below = self.paths.get(self.layer - 1, ())
        if not below or not model.overlapped or request.of_other_planner:
            return 1.0
        return alignment.gain(alignment.offset(request.paths, below, request.bead_width))

    def flow_factor(self, request: CorrectionInput) -> float:
        """Of the layer that the request is for. What eq 2.19 will take off its feed is put back: how high the beads
        come out is decided by what the scans show. The share of a pattern is not asked for: most of it is lost at rims.
        """
        slope = self.slope_of(self.model_of(request))
        return self._believed(self._told(request)).flow_factor(slope) / request.heat_factor

    def model_of(self, request: CorrectionInput) -> BeadModel | None:
        """Of the layer that the request is for; None when its beads are not told."""
        return self._of_paths(
            request.paths, request.z.shape, request.resolution, request.bead_width
        )

    def _model_laid(self, number: int, layer: Layer) -> BeadModel | None:
        """Of a layer that was laid; None when its beads were not told."""
        paths = self.paths.get(number, ())
        return self._of_paths(paths, layer.before.shape, layer.resolution, layer.bead_width)

    @staticmethod
    def _of_paths(
        paths: tuple[np.ndarray, ...], shape: tuple[int, ...], resolution: float, width: float
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
