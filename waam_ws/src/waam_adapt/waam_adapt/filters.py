"""Filters on height maps with holes: continuation to unknown cells, distance to edges, inverse of
overlapping beads.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import fft
from scipy.ndimage import distance_transform_edt, maximum_filter

from waam_process.bead import AREA_FACTOR

ERROR_PRIOR = 0.25e-3  # m, typical size of a height error: sets how much a map's uncertainty counts


def extend(values: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """values with every cell outside `known` set to that of the nearest known cell, and the
    distance to it in cells.
    """
    if known.all():
        return values, np.zeros(known.shape)
    distance, nearest = _nearest(known.tobytes(), known.shape)
    return values.ravel()[nearest], distance


@lru_cache(maxsize=6)
def _nearest(known: bytes, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Distance in cells to the nearest known cell, and its flat index, both of `shape`. One of the masks of a request
    is its footprint, which comes back in layer after layer."""
    mask = np.frombuffer(known, bool).reshape(shape)
    distance, (rows, cols) = distance_transform_edt(~mask, return_indices=True)
    nearest = rows * shape[1] + cols
    for kept in (distance, nearest):
        kept.flags.writeable = False
    return distance, nearest


def depth(mask: np.ndarray, weights: tuple[float, float] = (1.0, 1.0)) -> np.ndarray:
    """Distance in cells from every cell of the mask to the nearest cell outside it; the border of
    the map counts as outside. weights: what a cell counts along rows' and columns' axis.
    """
    return distance_transform_edt(np.pad(mask, 1), sampling=weights)[1:-1, 1:-1]


def away_from_edges(
    mask: np.ndarray, margin: float, direction: tuple[float, float] = (0.0, 0.0), along: float = 0.7
) -> np.ndarray:
    """Cells of the mask at least `margin` cells from its edge; where the mask is narrower, its middle.

    Where beads run along x or y, only the share `along` of the margin is kept at their ends: a bead's flank is half its
    width, its end is steeper.
    """
    return _away_from_edges(mask.tobytes(), mask.shape, margin, _weights(direction, along))


@lru_cache(maxsize=4)
def _away_from_edges(
    mask: bytes, shape: tuple[int, int], margin: float, weights: tuple[float, float]
) -> np.ndarray:
    """See `away_from_edges`."""
    within = np.frombuffer(mask, bool).reshape(shape)
    inside = depth(within, weights)
    thickest = maximum_filter(inside, size=4 * int(np.ceil(margin)) + 1)
    away = within & (inside >= np.minimum(margin, 0.7 * thickest))
    away.flags.writeable = False
    return away


def inner_share(mask: np.ndarray, margin: float) -> np.ndarray:
    """(rows, cols) 0..1: share of every cell of the mask that is at least `margin` cells from its edge; where the mask
    is narrower, its middle. Means of it are the same on a finer map."""
    return _inner_share(mask.tobytes(), mask.shape, margin)


@lru_cache(maxsize=4)
def _inner_share(mask: bytes, shape: tuple[int, int], margin: float) -> np.ndarray:
    """Footprints are the same in layer after layer."""
    far = depth(np.frombuffer(mask, bool).reshape(shape))
    thickest = maximum_filter(far, size=4 * int(np.ceil(margin)) + 1)
    return np.clip(far - np.minimum(margin, 0.7 * thickest), 0.0, 1.0)


def _weights(direction: tuple[float, float], along: float) -> tuple[float, float]:
    x, y = abs(direction[0]), abs(direction[1])
    if x > 10 * y:
        return 1.0, 1 / along
    return (1 / along, 1.0) if y > 10 * x else (1.0, 1.0)


def reliability(sigma: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    """0..1: share of a measured error that is to be believed, prior variance over prior plus
    measurement variance.

    sigma in m; unknown uncertainty counts as 0.1 mm.
    """
    s = np.full(shape, 1e-4) if sigma is None else np.where(np.isfinite(sigma), sigma, 1e-4)
    return ERROR_PRIOR**2 / (ERROR_PRIOR**2 + s**2)


def bead_transfer(frequency: np.ndarray, width: float) -> np.ndarray:
    """Fourier transform (1 at zero) of a parabolic bead section of `width` m at spatial frequencies
    in 1/m.
    """
    a = np.pi * np.asarray(frequency, float) * width
    small = np.abs(a) < 1e-2
    a = np.where(small, 1.0, a)
    return np.where(small, 1.0, 3 * (np.sin(a) - a * np.cos(a)) / a**3)


@lru_cache(maxsize=8)
def inverse_transfer(
    shape: tuple[int, int],
    resolution: float,
    width: float,
    direction: tuple[float, float],
    reg: float,
) -> np.ndarray:
    """Real transfer function on the half plane of rfft2: B/(B^2 + reg) times a low pass that ends
    at the bead pitch.

    B is the bead section across the direction. Waves shorter than two pitches cannot be made by
    beads one pitch apart; those of one pitch are the beads themselves and would be sampled as a
    false level on every bead, so the low pass is at 0.01 there.
    """
    fy, fx = np.meshgrid(
        fft.fftfreq(shape[0], resolution), fft.rfftfreq(shape[1], resolution), indexing='ij'
    )
    total = np.hypot(fx, fy)
    norm = np.hypot(*direction)
    across = total if norm == 0 else np.abs(-fx * direction[1] + fy * direction[0]) / norm
    b = bead_transfer(across, width)
    low_pass = 1 / (1 + (total * 1.55 * AREA_FACTOR * width) ** 8)
    return (1 + reg) * b / (b**2 + reg) * low_pass


def inverse_bead_filter(
    values: np.ndarray,
    resolution: float,
    width: float,
    direction: tuple[float, float],
    regularisation: float,
) -> np.ndarray:
    """The metal to lay so that overlapping parabolic beads of `width` m add up to `values`, as far
    as beads can.

    A regularised deconvolution (Tikhonov) in the frequency domain with gain 1 for a constant; the
    map is mirrored at its border.
    """
    pad = int(np.ceil(2 * width / resolution))
    padded = np.pad(values, pad, mode='symmetric')
    shape = tuple(fft.next_fast_len(n, real=True) for n in padded.shape)
    padded = np.pad(
        padded, [(0, n - m) for n, m in zip(shape, padded.shape, strict=True)], mode='edge'
    )
    transfer = inverse_transfer(shape, resolution, width, direction, regularisation)
    out = fft.irfft2(fft.rfft2(padded) * transfer, s=shape)
    rows, cols = values.shape
    return out[pad : pad + rows, pad : pad + cols]
