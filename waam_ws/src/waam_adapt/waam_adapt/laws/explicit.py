"""Correction laws: the surface that was scanned and the metal that is planned in, psi(x, y) of the
next layer out.

Every law, explicit or learned, has the same interface (`CorrectionLaw`), so the server does not
know which one it runs. Maps are (rows, cols) on one grid, rows along +y, columns along +x, metres,
NaN = unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from .. import filters
from ..beads.bead_bias import Learned

# relative layer height beyond which a bead is no bead of the regime any more
RATIO_LOW, RATIO_HIGH = 0.4, 1.8
LAWS = ('zero', 'proportional', 'log_log', 'damped_inverse', 'unet')
MIN_GAIN = 1e-3  # less authority over speed than this is none
MIN_PLANNED = 0.05e-3  # m; thinner than this the plan adds no metal


class CorrectionError(ValueError):
    """An input that no law can use; the text names the field."""


@dataclass(frozen=True)
class CorrectionInput:
    """What is known before a layer. Maps (rows, cols) in m; all on one grid of square cells.

    z: measured surface, NaN = never seen. target: wanted surface at this moment (before the layer),
    NaN = do not care. planned: metal that the plan adds in this layer, 0 or NaN outside its
    footprint. sigma: standard uncertainty of z or None. bead_width m; direction: (x, y) of the
    beads, (0, 0) = unknown; k_gain: authority of eq 2.23, V = V_prog*(1 + k_gain*psi). shortfall:
    share of the planned metal that is expected to be missing, already in target (`expecting`).
    paths: the beads of this layer from arc on to arc off in the order they are laid, arrays (n, 2)
    of x, y in m from the corner of cell (0, 0); empty = unknown. temperature of the layer below in
    degC, NaN = unknown. experience: layers of this direction of travel that shortfall was learned
    from. learned: what the beads of this layer will do unlike the nominal model, None = nothing known. The last
    five are for learned laws; explicit ones need them not.
    """

    z: np.ndarray
    target: np.ndarray
    planned: np.ndarray
    resolution: float
    bead_width: float
    k_gain: float
    sigma: np.ndarray | None = None
    direction: tuple[float, float] = (0.0, 0.0)
    shortfall: np.ndarray | None = None
    paths: tuple[np.ndarray, ...] = ()
    temperature: float = math.nan
    experience: int = 0
    learned: Learned | None = None

    def __post_init__(self) -> None:
        for name in ('target', 'planned', 'sigma', 'shortfall'):
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
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise CorrectionError(f'{name} is {value}, must be {low} .. {high}')
        if not np.isfinite(self.direction).all():
            raise CorrectionError(f'direction is {self.direction}, not finite')
        for i, p in enumerate(self.paths):
            if p.ndim != 2 or p.shape[1] != 2 or len(p) < 2 or not np.isfinite(p).all():
                raise CorrectionError(f'paths[{i}] must be finite points of shape (n >= 2, 2)')

    @property
    def footprint(self) -> np.ndarray:
        """(rows, cols) bool: where the plan adds metal."""
        return np.nan_to_num(self.planned) > MIN_PLANNED

    def expecting(self, shortfall: np.ndarray | None, experience: int = 0) -> CorrectionInput:
        """The same with the share of the planned metal (rows, cols) that will be missing again added to the target."""
        if shortfall is None or shortfall.shape != self.z.shape:
            return self
        target = self.target + shortfall * np.nan_to_num(self.planned)
        return replace(self, target=target, shortfall=shortfall, experience=experience)

    @property
    def error(self) -> np.ndarray:
        """Missing metal target - z in m: positive in a hollow. NaN where unknown or not cared
        for.
        """
        return self.target - self.z


@dataclass(frozen=True)
class Correction:
    """psi -1..1 (0 where nothing is known), confidence 0..1 and residual_height m, each (rows,
    cols).
    """

    psi: np.ndarray
    confidence: np.ndarray
    residual_height: np.ndarray
    law: str
    k_gain: float
    model_hash: str = ''
    fallback: bool = False
    reasons: tuple[str, ...] = field(default=())

    @property
    def speed_factor(self) -> np.ndarray:
        """V/V_prog of eq 2.23."""
        return 1.0 + self.k_gain * self.psi

    @property
    def saturated_cells(self) -> int:
        return int(np.count_nonzero(np.abs(self.psi) >= 1.0))


class CorrectionLaw(Protocol):
    """One way to get psi from what was measured. `model_hash` in the result identifies learned
    weights.
    """

    name: str

    def correct(self, request: CorrectionInput) -> Correction: ...


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
class Zero:
    """No correction: the plan as it is."""

    name: str = 'zero'

    def correct(self, request: CorrectionInput) -> Correction:
        return nothing(request.z.shape, request.k_gain, self.name)


def cell_by_cell(
    request: CorrectionInput, name: str, faster: Callable[[np.ndarray], np.ndarray]
) -> Correction:
    """A law without neighbours and residual. faster: relative change of speed (rows, cols) for the missing share of the
    planned metal (rows, cols), 0 for 0."""
    if request.k_gain < MIN_GAIN:
        return nothing(request.z.shape, request.k_gain, name)
    known = request.footprint & np.isfinite(request.error)
    missing = np.where(known, request.error, 0.0) / np.where(known, request.planned, 1.0)
    psi = np.clip(faster(missing) / request.k_gain, -1.0, 1.0)
    confidence = np.where(known, filters.reliability(request.sigma, known.shape), 0.0)
    return Correction(psi, confidence, np.zeros_like(psi), name, request.k_gain)


@dataclass(frozen=True)
class Proportional:
    """psi = -gain*error/(k_gain*planned), cell by cell: no smoothing, no knowledge of the bead, no
    residual for the feed.

    Kept as the plain reference that published cells use; `DampedInverse` is the one to weld with.
    """

    gain: float = 0.7
    name: str = 'proportional'

    def correct(self, request: CorrectionInput) -> Correction:
        return cell_by_cell(request, self.name, lambda missing: -self.gain * missing)


@dataclass(frozen=True)
class LogLog:
    """Speed from the inverse of one fixed model ln(height) = exponent*ln(speed) + b, cell by cell, no residual.

    1 + k_gain*psi = (wanted/planned)**(1/exponent); b cancels, for the plan's height belongs to the plan's speed. What
    published single-bead cells do with their regression; exponent: -0.5 lies amid the fits of the material table.
    """

    gain: float = 0.7
    exponent: float = -0.5
    name: str = 'log_log'

    def correct(self, request: CorrectionInput) -> Correction:
        def faster(missing: np.ndarray) -> np.ndarray:
            ratio = np.clip(1 + self.gain * missing, RATIO_LOW, RATIO_HIGH)
            return ratio ** (1 / self.exponent) - 1

        return cell_by_cell(request, self.name, faster)


@dataclass(frozen=True)
class Wish:
    """ratio: wanted over planned layer height; planned m, continued outside the footprint;
    confidence 0..1. All (rows, cols).
    """

    ratio: np.ndarray
    planned: np.ndarray
    confidence: np.ndarray


@dataclass(frozen=True)
class DampedInverse:
    """Inverse of the overlap of beads, smoothed over their footprint and damped.

    The missing metal is taken from the trusted cells (`filters.away_from_edges`: near the footprint's edge the slope of
    the outermost bead is seen, not the level), continued outwards from the nearest of them, filtered by
    `filters.inverse_bead_filter`, and asked for in the share `gain`. The wanted relative layer height is limited to
    RATIO_LOW..RATIO_HIGH and split into speed and residual by `split_ratio`. Away from known cells of the footprint
    confidence and correction fade to 0 at `reach` bead widths, so a small hole is bridged and a wide one is left alone.
    """

    gain: float = 0.9
    regularisation: float = 0.1
    edge_margin: float = 0.5
    reach: float = 0.5
    name: str = 'damped_inverse'

    def correct(self, request: CorrectionInput) -> Correction:
        w = self.wish(request)
        if w is None:
            reason = 'no known cell in the footprint'
            return nothing(request.z.shape, request.k_gain, self.name, (reason,))
        psi, residual = split_ratio(w.ratio, w.planned, request.k_gain)
        return Correction(psi, w.confidence, residual, self.name, request.k_gain)

    def wish(self, request: CorrectionInput) -> Wish | None:
        """What is asked of every cell before it is split into speed and residual; None without a known cell."""
        known = request.footprint & np.isfinite(request.error)
        if not known.any():
            return None
        width = request.bead_width / request.resolution  # cells
        trusted = known & filters.away_from_edges(
            request.footprint, self.edge_margin * width, request.direction
        )
        missing, _ = filters.extend(request.error, trusted if trusted.any() else known)
        wanted = filters.inverse_bead_filter(
            missing, request.resolution, request.bead_width, request.direction, self.regularisation
        )
        planned, _ = filters.extend(request.planned, request.footprint)
        confidence = self._confidence(request, known, width)
        ratio = np.clip(1 + self.gain * confidence * wanted / planned, RATIO_LOW, RATIO_HIGH)
        return Wish(ratio, planned, confidence)

    def _confidence(self, request: CorrectionInput, known: np.ndarray, width: float) -> np.ndarray:
        """(rows, cols) 0..1 from uncertainty and distance of the nearest known cell; width of a bead in cells."""
        sigma = np.full(known.shape, np.nan) if request.sigma is None else request.sigma
        nearest, distance = filters.extend(sigma, known)
        fade = np.clip(2 * (1 - distance / (self.reach * width)), 0.0, 1.0)
        return fade * filters.reliability(nearest, known.shape)


def make_law(
    name: str, gain: float = 0.9, regularisation: float = 0.1, model: str = ''
) -> CorrectionLaw:
    """The law of that name; CorrectionError names the known ones. model: file of weights for unet,
    '' = the packaged one, 'none' = its bead model without a network.
    """
    if name not in LAWS:
        raise CorrectionError(f"unknown law '{name}'; known are {', '.join(LAWS)}")
    inverse = DampedInverse(gain, regularisation)
    if name == 'unet':
        from .net_law import UNetLaw  # reads weights: only who asks for it pays

        return UNetLaw.load(model, inverse)
    laws = (Zero(), Proportional(gain), LogLog(gain), inverse)
    return {law.name: law for law in laws}[name]


def safe_correct(
    law: CorrectionLaw, request: CorrectionInput, reasons: tuple[str, ...]
) -> Correction:
    """The law's correction, or none at all (fallback) when there are reasons against the input or
    the output is not usable.
    """
    shape, k_gain = request.z.shape, request.k_gain
    if reasons:
        return nothing(shape, k_gain, law.name, reasons)
    result = law.correct(request)
    maps = (result.psi, result.confidence, result.residual_height)
    if any(m.shape != shape or not np.isfinite(m).all() for m in maps):
        return nothing(shape, k_gain, law.name, (f'law {law.name} gave a map that is not finite',))
    if np.abs(result.psi).max() > 1.0:
        return nothing(shape, k_gain, law.name, (f'law {law.name} gave |psi| above 1',))
    return result
