"""What a correction law gets and gives: the types that laws, bead model and identification share.

Maps are (rows, cols) on one grid, rows along +y, columns along +x, metres, NaN = unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np

# relative layer height beyond which a bead is no bead of the regime any more
RATIO_LOW, RATIO_HIGH = 0.4, 2.6
MIN_GAIN = 1e-3  # less authority over speed than this is none
MIN_PLANNED = 0.05e-3  # m; thinner than this the plan adds no metal


T = TypeVar('T')


def with_side(pair: tuple[T, T], side: int, value: T) -> tuple[T, T]:
    """The pair with another value of `side`: 0 of even layers, 1 of odd ones."""
    return (pair[0], value) if side else (value, pair[1])


class CorrectionError(ValueError):
    """An input that no law can use; the text names the field."""


@dataclass(frozen=True)
class LastLayer:
    """The layer under the scan. Maps (rows, cols) in m, None = not known."""

    before: np.ndarray | None = None  # surface that it was laid on
    growth: np.ndarray | None = None  # what its setpoints asked for
    feed_factor: float = 1.0  # of the wire feed that it was laid with, flow times heat


@dataclass(frozen=True)
class BeadDeviation:
    """What the beads of one layer will do unlike the nominal bead model."""

    # (rows, cols), share of the planned height that is missing beside the model's growth
    missing: np.ndarray
    lag: float = 0.0  # of the metal along the travel, m
    slope: float = 1.0  # of growth on metal
    scale: float = 1.0  # what the error of the request was divided by for that slope
    fill: float = 1.0  # 0..1, share of what the end of a bead may be asked for beside others, by what came of it
    layers: int = 0  # of this job that have taught this
    scatter: float = 0.02  # standard deviation of a layer's efficiency about the process
    response: float = 0.3  # 0..1, of growth near the ends of beads on what is asked for there


@dataclass(frozen=True)
class Forecast:
    """What a network says that the base law would leave of a layer, on the grid a quarter of a bead wide.

    shape (rows, cols): share of the planned height by which the layer would end too high, mean 0; sigma (rows, cols):
    standard uncertainty of the outcome; counted (rows, cols): how much a cell is judged, 0..1; level: the mean, as a
    share. digest: of the network. doubt: why nothing is told (all 0), ''. weight: 0..1, of the shape in this job, NaN:
    not weighed yet; shape and level are weighed with it.
    """

    shape: np.ndarray
    sigma: np.ndarray
    counted: np.ndarray
    level: float = 0.0
    digest: str = ''
    doubt: str = ''
    weight: float = math.nan

    @property
    def rms(self) -> float:
        """Share of the planned height that is expected to be left, RMS; 0 where nothing is told."""
        total = float(self.counted.sum())
        if not self.digest or total <= 0:
            return 0.0
        return math.sqrt(float((self.counted * self.sigma**2).sum()) / total)

    def weighed(self, shape: float, level: float) -> Forecast:
        """With the weights (0..1) of a job."""
        return replace(self, shape=shape * self.shape, level=level * self.level, weight=shape)


@dataclass(frozen=True)
class CorrectionInput:
    """What is known before a layer. Maps are (rows, cols) in m, all on one grid of square cells."""

    z: np.ndarray  # measured surface, NaN = never seen
    target: np.ndarray  # wanted surface at this moment, before the layer; NaN = do not care
    planned: np.ndarray  # metal that the plan adds in this layer, 0 or NaN outside its footprint
    resolution: float  # edge of a cell, m
    bead_width: float  # m
    k_gain: float  # authority of eq 2.23, V = V_prog*(1 + k_gain*psi)
    sigma: np.ndarray | None = None  # standard uncertainty of z
    direction: tuple[float, float] = (0.0, 0.0)  # (x, y) of the beads, (0, 0) = unknown
    # The rest is for learned laws; explicit laws do not read it.
    # The beads from arc on to arc off in the order they are laid: arrays (n, 2) of x, y in m from the corner of
    # cell (0, 0); empty = unknown.
    paths: tuple[np.ndarray, ...] = ()
    temperature: float = math.nan  # of the layer below, degC, NaN = unknown
    learned: BeadDeviation | None = None  # what the beads of this layer do unlike the nominal model
    heat_factor: float = 1.0  # of the wire feed by eq 2.19, that this layer will be laid with
    # what the base law would leave of this layer; None = the law asks its network itself
    forecast: Forecast | None = None
    ratio_high: float = 0.0  # largest relative layer height of a setpoint; 0 = the law's own limits
    next_thickness: float = 0.0  # m, median metal of the layer after this one; 0 = none, not known

    def __post_init__(self) -> None:
        for name in ('target', 'planned', 'sigma'):
            a = getattr(self, name)
            if a is not None and a.shape != self.z.shape:
                raise CorrectionError(f'{name} has shape {a.shape}, the map {self.z.shape}')
            if a is not None and np.isinf(a).any():
                raise CorrectionError(f'{name} has infinite values')
        if np.isinf(self.z).any():
            raise CorrectionError('z has infinite values')
        if np.nanmin(self.planned, initial=0.0) < 0:
            raise CorrectionError('planned has negative values: a layer cannot take metal away')
        for name, low, high in (
            ('resolution', 1e-5, 0.02),
            ('bead_width', 5e-4, 0.05),
            ('k_gain', 0, 0.9),
            ('heat_factor', 0.1, 1.0),
            ('next_thickness', 0.0, 0.05),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise CorrectionError(f'{name} is {value}, must be {low} .. {high}')
        if self.ratio_high and not 1.0 <= self.ratio_high <= 10.0:
            raise CorrectionError(f'ratio_high is {self.ratio_high}, must be 0 or 1 .. 10')
        if not np.isfinite(self.direction).all():
            raise CorrectionError(f'direction is {self.direction}, not finite')
        for i, p in enumerate(self.paths):
            if p.ndim != 2 or p.shape[1] != 2 or len(p) < 2 or not np.isfinite(p).all():
                raise CorrectionError(f'paths[{i}] must be finite points of shape (n >= 2, 2)')

    @cached_property
    def footprint(self) -> np.ndarray:
        """(rows, cols) bool: where the plan adds metal."""
        return np.nan_to_num(self.planned) > MIN_PLANNED

    @property
    def of_other_planner(self) -> bool:
        """A program of others: its plan names what a setpoint may ask for."""
        return self.ratio_high > 0

    def with_prediction(
        self, forecast: Forecast | None = None, learned: BeadDeviation | None = None
    ) -> CorrectionInput:
        """With what is believed of the layer."""
        return replace(self, forecast=forecast or self.forecast, learned=learned or self.learned)

    @property
    def error(self) -> np.ndarray:
        """Missing metal target - z in m: positive in a hollow. NaN where unknown or not cared
        for.
        """
        return self.target - self.z


@dataclass(frozen=True)
class Correction:
    """The answer of a law. Maps are (rows, cols)."""

    psi: np.ndarray  # -1..1, 0 where nothing is known
    confidence: np.ndarray  # 0..1
    residual_height: np.ndarray  # m that the speed cannot give
    law: str
    k_gain: float
    model_hash: str = ''  # of learned weights
    fallback: bool = False  # the law gave way, see `reasons`
    reasons: tuple[str, ...] = field(default=())

    @property
    def speed_factor(self) -> np.ndarray:
        """V/V_prog of eq 2.23."""
        return 1.0 + self.k_gain * self.psi

    @property
    def saturated_cells(self) -> int:
        """Cells where psi is at its limit."""
        return int(np.count_nonzero(np.abs(self.psi) >= 1.0))


class CorrectionLaw(Protocol):
    """One way to get psi from what was measured. `model_hash` in the result identifies learned
    weights.
    """

    @property
    def name(self) -> str:
        """As in `registry.LAWS` and in the correction map."""

    def correct(self, request: CorrectionInput) -> Correction:
        """psi and its terms for a layer. Never raises for a map that passed `CorrectionInput`."""

    def prepare(self, request: CorrectionInput) -> None:
        """Computes, and keeps, what the paths of a layer alone decide: `correct` is quicker then. The request tells its
        paths and has a footprint."""


def nothing(
    shape: tuple[int, int], k_gain: float, law: str, reasons: tuple[str, ...] = ()
) -> Correction:
    """No correction at all; with reasons it is a fallback."""
    zero = np.zeros(shape)
    return Correction(zero, zero, zero, law, k_gain, fallback=bool(reasons), reasons=reasons)


def split_ratio(
    ratio: np.ndarray, planned: np.ndarray, k_gain: float
) -> tuple[np.ndarray, np.ndarray]:
    """psi and residual_height (m) that together give layer heights ratio*planned: speed first,
    inside |psi| <= 1.

    On overlapped beads the layer height goes with 1/speed, so 1 + k_gain*psi = 1/ratio. What the
    speed cannot give is the residual ratio*planned - planned/(1 + k_gain*psi); it is exactly 0
    where psi is not limited.
    """
    if k_gain < MIN_GAIN:
        return np.zeros_like(ratio), (ratio - 1) * planned
    free = (1 / ratio - 1) / k_gain
    psi = np.clip(free, -1.0, 1.0)
    residual = np.where(psi == free, 0.0, planned * (ratio - 1 / (1 + k_gain * psi)))
    return psi, residual


@dataclass(frozen=True)
class HeightRequest:
    """The layer height that a law asks of every cell, before it is split into speed and residual. All (rows, cols)."""

    ratio: np.ndarray  # wanted over planned layer height
    planned: np.ndarray  # m, continued outside the footprint
    confidence: np.ndarray  # 0..1
    held: (
        np.ndarray
    )  # share of the planned height in ratio that holds the level where nothing was seen


def error_figures(request: CorrectionInput) -> tuple[float, float]:
    """RMS and largest absolute height error over the footprint in m; NaN when nothing of it is
    known.
    """
    error = request.error[request.footprint]
    error = error[np.isfinite(error)]
    if not error.size:
        return float('nan'), float('nan')
    return float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
