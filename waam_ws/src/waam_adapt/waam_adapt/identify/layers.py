"""The memory of the layers of a job: each as it was asked for, and as the next scan shows it. `Identifier` makes both;
the estimators write what they find where the ones after them, and the next scan, can read it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..beads.model import BeadModel, bead_model
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import CorrectionInput, Forecast
from .estimate import Estimate
from .evidence import Layer, LayerEvidence


@dataclass(frozen=True)
class Outcome:
    """m: expected RMS of the coming surface, and its 90 % interval."""

    rms: float
    low: float
    high: float


@dataclass
class AskedLayer:
    """A layer before it is laid."""

    number: int
    request: CorrectionInput  # as it came
    trusted: bool = True  # its map may be used
    process: Estimate = Estimate()  # by `Efficiency`: believed of it
    layers_seen: int = 0  # of this job
    forecast: Forecast | None = None  # by the network, as it is
    weighed: Forecast | None = None  # as it was believed
    outcome: Outcome | None = None  # None = nothing can be said

    @property
    def wanted(self) -> np.ndarray:
        """(rows, cols) m: the surface that it was to end with."""
        return self.request.target + np.nan_to_num(self.request.planned)

    @property
    def pattern(self) -> tuple[np.ndarray, ...]:
        """The beads whose pattern tells its kind; none of plans of our own (`path_patterns`)."""
        return self.request.paths if self.request.of_other_planner else ()

    @property
    def forecast_level(self) -> float:
        """By which share of its height it was believed to end too high."""
        return self.weighed.level if self.weighed else 0.0


@dataclass
class SeenLayer:
    """A layer that was laid, when enough of it can be seen."""

    number: int
    layer: Layer
    evidence: LayerEvidence
    model: BeadModel | None  # None: its beads were not told
    asked: AskedLayer | None  # None: nobody asked this server for it
    laid_with: Estimate = field(
        default_factory=Estimate
    )  # by `Efficiency`: believed of it when it was laid
    process: Estimate = field(default_factory=Estimate)  # by `Efficiency`: believed now


def grid_of(shape: tuple[int, int], resolution: float, bead_width: float) -> Resampler:
    """The bead model's, a quarter of a bead wide."""
    return Resampler.of(shape, resolution, bead_width / CELLS_PER_BEAD)


def model_of(
    paths: tuple[np.ndarray, ...], shape: tuple[int, int], resolution: float, width: float
) -> BeadModel | None:
    """None when the beads are not told."""
    if not paths:
        return None
    rows, cols = shape
    return bead_model(paths, grid_of((rows, cols), resolution, width).shape, width)


def model_of_request(request: CorrectionInput) -> BeadModel | None:
    """Of the layer that the request is for."""
    return model_of(request.paths, request.z.shape, request.resolution, request.bead_width)
