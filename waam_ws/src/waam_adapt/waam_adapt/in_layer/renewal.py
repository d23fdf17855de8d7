"""What profiles beside the arc change in the rest of a layer.

Two things are seen: ground on which no metal of the layer lies yet, and what grew where all of it lies. Ground that is
not as the map said changes what its own cells need. Growth that is not what was asked for is expected of the beads
still to come as well: as far as neighbours share it, and as far as the whole layer does.

How much a cell is believed is one weight, gain * n / (n + points) * 2^(-age / half_life): it rises with the number n of
points and fades with their age. So a single look moves little, and what was seen long ago nothing. What the whole layer
shares, its level, is the median of many cells and comes from the wire, which stays what it is: it is believed as far as
its own uncertainty allows against what may be expected of a wire (`Belief.level_sigma`), and does not fade.

Pure. Maps are (rows, cols), m, NaN = unknown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..types import (
    MIN_PLANNED,
    RATIO_HIGH,
    RATIO_LOW,
    Correction,
    CorrectionError,
    split_ratio,
)

GROUND_REACH = 0.4  # bead widths; finer steps of the ground no bead can follow
OUTLIER = 0.5  # of the planned height; growth that is off by more is no growth of a bead
ENOUGH = 0.25  # share of the neighbourhood that counts half
RIM = 0.25  # bead widths from the edge of the layer whose growth says nothing of its level
PATCH = 1.5  # bead widths; metal nearer to each other than that is off together
LEVEL_FLOOR = 0.015  # of the relative height: the first beads of a layer are not quite the others, however many cells
LEAST_SCATTER = 0.04  # of the relative height, of patches: that of a few cells says little
LEAST = 1e-4  # change of the relative layer height that is one


@dataclass(frozen=True)
class Belief:
    """How much is believed of what was seen beside the arc."""

    gain: float = 0.3  # largest weight
    level_sigma: float = 0.06  # of the level of a layer before it is seen; 0 = it is not asked for
    points: float = 30.0  # behind a cell, for half of it
    half_life: float = 60.0  # s
    reach: float = 1.2  # bead widths over which beads share their deviation (sigma)
    limit: float = 0.3  # of the relative layer height, largest change

    def weight(self, count: np.ndarray, age: np.ndarray) -> np.ndarray:
        """(rows, cols) 0 .. gain. count: points behind each cell; age: s since they were seen."""
        n = np.maximum(np.nan_to_num(count), 0.0)
        fresh = np.exp2(-np.maximum(np.nan_to_num(age, nan=np.inf), 0.0) / self.half_life)
        return self.gain * n / (n + self.points) * fresh


@dataclass(frozen=True)
class Seen:
    """What was seen while the layer is laid: surface less what it should be, m, NaN = not seen.

    ground: where no metal of the layer lies; growth: where all of it lies; count: points behind either; age: s.
    """

    ground: np.ndarray
    growth: np.ndarray
    count: np.ndarray
    age: np.ndarray

    def __post_init__(self) -> None:
        for name in ('growth', 'count', 'age'):
            shape = getattr(self, name).shape
            if shape != self.ground.shape:
                raise CorrectionError(f'{name} has shape {shape}, ground {self.ground.shape}')


@dataclass(frozen=True)
class Renewal:
    """correction: takes the place of the layer's own; change (rows, cols): of the relative layer height against it."""

    correction: Correction
    change: np.ndarray


def renew(
    base: Correction,
    planned: np.ndarray,
    seen: Seen,
    cell: float,
    bead_width: float,
    belief: Belief | None = None,
) -> Renewal:
    """The correction for what is still to come. base: the one that the layer began with; planned (rows, cols) m of
    metal; cell: edge, m. Where nothing follows from what was seen, base stays to the last bit. CorrectionError for
    shapes that do not fit."""
    belief = belief or Belief()
    if not planned.shape == base.psi.shape == seen.ground.shape:
        raise CorrectionError(
            f'psi has shape {base.psi.shape}, planned {planned.shape}, ground {seen.ground.shape}'
        )
    metal = np.nan_to_num(planned)
    footprint = metal > MIN_PLANNED
    height = np.where(footprint, metal, 1.0)
    weight = belief.weight(seen.count, seen.age)
    width = bead_width / cell
    ground = _spread(
        np.where(footprint, seen.ground / height, np.nan), weight, GROUND_REACH * width
    )
    grown = np.where(footprint, seen.growth / height, np.nan)
    grown = np.where(np.abs(grown) <= OUTLIER, grown, np.nan)
    level, trust = _level(grown, footprint, width, belief.level_sigma)
    near = _spread(grown - level, weight, belief.reach * width)
    # metal in proportion: half of the growth needs twice of it
    lacking = -trust * level / (1 + trust * level)
    change = np.clip(lacking - ground - near, -belief.limit, belief.limit)
    change = np.where(footprint & (np.abs(change) > LEAST), change, 0.0)
    return Renewal(_changed(base, height, change), change)


def _known(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    known = np.isfinite(values)
    return known, np.where(known, values, 0.0)


def _spread(values: np.ndarray, weight: np.ndarray, sigma: float) -> np.ndarray:
    """Weighted mean of the known values within sigma cells, less where few are known."""
    known, v = _known(values)
    if not known.any():
        return np.zeros(values.shape)
    from scipy.ndimage import gaussian_filter  # nodes that renew nothing start without it

    share = gaussian_filter(known.astype(float), sigma)
    total = gaussian_filter(weight * v, sigma)
    return total / np.maximum(share, 1e-9) * share / (share + ENOUGH)


def _level(
    grown: np.ndarray, footprint: np.ndarray, width: float, sigma: float
) -> tuple[float, float]:
    """Relative deviation of the growth that all of the layer shares, the median, and how far it is believed, 0..1: the
    gain of a Kalman filter, from `sigma` (before anything was seen) and the scatter of the cells. width: of a bead, in
    cells.
    """
    from .. import filters  # it needs scipy

    inner = filters.inner_share(footprint, RIM * width) > 0.5
    seen = grown[inner & np.isfinite(grown)]
    patches = len(seen) / (PATCH * width) ** 2
    if sigma <= 0 or patches < 1:
        return 0.0, 0.0
    level = float(np.median(seen))
    scatter = max(1.4826 * float(np.median(np.abs(seen - level))), LEAST_SCATTER)
    noise = LEVEL_FLOOR**2 + scatter**2 / patches
    return level, sigma**2 / (sigma**2 + noise)


def _changed(base: Correction, height: np.ndarray, change: np.ndarray) -> Correction:
    """base with the relative layer height changed, divided into speed and residual once."""
    hit = change != 0.0
    if not hit.any():
        return base
    ratio = 1.0 / (1.0 + base.k_gain * base.psi) + base.residual_height / height
    wanted = np.clip(ratio + change, RATIO_LOW, RATIO_HIGH)
    psi, residual = split_ratio(wanted, height, base.k_gain)
    return replace(
        base,
        psi=np.where(hit, psi, base.psi),
        residual_height=np.where(hit, residual, base.residual_height),
    )
