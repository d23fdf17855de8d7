"""Shapes on a grid: grow, shrink, close, islands, edge-preserving smoothing. Masks are (rows, cols) bool, maps
(rows, cols) m with NaN = unknown, distances in cells."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from waam_process.grid import GridSpec

EIGHT = np.ones((3, 3), bool)
# bead widths: a wall up to this thickness is one bead, beyond it two overlap better
ONE_BEAD = 1.05
FLANK = np.radians(60.0)  # of a face against the level: steeper ones are no tops
CROWN = 0.25  # bead widths: over its middle quarter a bead falls by 6 % of its height


def distance_inside(mask: np.ndarray) -> np.ndarray:
    """Distance in cells from each set cell to the nearest unset one; the world outside the grid is unset."""
    return ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]


def judged(mask: np.ndarray, rim: float, bead: float) -> np.ndarray:
    """Cells by which a surface laid on the mask is judged: all but a rim; of walls one bead thick the crown.

    rim, bead (width of one): cells. Where no disc of ONE_BEAD beads fits in, the middle CROWN of a bead is left,
    however narrow the wall is.
    """
    inside = distance_inside(mask) - 0.5
    thin = mask & ~drop_slivers(mask, ONE_BEAD / 2 * bead)
    half = int(np.ceil(ONE_BEAD / 2 * bead))
    ridge = ndimage.grey_dilation(np.where(mask, inside, 0.0), footprint=_disc(half))
    crown = thin & (ridge <= ONE_BEAD / 2 * bead) & (inside >= ridge - CROWN / 2 * bead)
    return np.where(thin & (ridge <= ONE_BEAD / 2 * bead), crown, mask & (inside >= rim))


def flanks(z: np.ndarray, cell: float) -> np.ndarray:
    """Cells (rows, cols) bool on a face of z (m) that is steeper than FLANK on both sides of them, along x or y.

    There a height says nothing about the metal: 0.1 mm to the side is more than 0.17 mm of height. Cells at the upper
    and at the lower edge of the face belong to what lies level beside it; unknown neighbours do not count.
    """
    found = np.zeros(z.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(z, axis=axis)) / cell
        wide = [(1, 1) if n == axis else (0, 0) for n in (0, 1)]
        padded = np.pad(step, wide, constant_values=np.nan)
        before, after = (np.take(padded, np.arange(z.shape[axis]) + k, axis) for k in (0, 1))
        least = np.fmin(before, after)
        found |= np.nan_to_num(least, nan=0.0) > np.tan(FLANK)
    return found


def _disc(radius: float) -> np.ndarray:
    at = np.arange(-int(radius), int(radius) + 1)
    return at[:, None] ** 2 + at[None] ** 2 <= radius**2


def overrun(mask: np.ndarray, free: np.ndarray, cells: float) -> np.ndarray:
    """The mask and what is free beside it, `cells` far."""
    if cells <= 0 or not mask.any():
        return mask.copy()
    return mask | (free & (ndimage.distance_transform_edt(~mask) - 0.5 < cells))


def spread(values: np.ndarray, mask: np.ndarray, wider: np.ndarray) -> np.ndarray:
    """Values of the mask, on the cells of a wider one too, each as at the nearest cell of the mask; 0 elsewhere."""
    if not mask.any() or not (wider & ~mask).any():
        return np.where(mask, values, 0.0)
    row, col = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return np.where(mask | wider, values[row, col], 0.0)


def close_gaps(mask: np.ndarray, cells: float) -> np.ndarray:
    """Grow then shrink by `cells`: fills notches and holes narrower than twice that, adds only."""
    if cells <= 0 or not mask.any():
        return mask.copy()
    pad = int(np.ceil(cells)) + 2
    wide = np.pad(mask, pad)
    grown = ndimage.distance_transform_edt(~wide) <= cells
    back = ndimage.distance_transform_edt(grown) > cells
    return mask | back[pad:-pad, pad:-pad]


def drop_slivers(mask: np.ndarray, cells: float) -> np.ndarray:
    """Shrink then grow by `cells`: removes what is narrower than twice that, rounds corners, adds nothing."""
    if cells <= 0 or not mask.any():
        return mask.copy()
    core = distance_inside(mask) - 0.5 >= cells
    return mask & (ndimage.distance_transform_edt(~core) <= cells + 0.5)


def islands(mask: np.ndarray) -> list[np.ndarray]:
    """The connected parts (8 neighbours) of a mask, each as a mask of the same shape."""
    labels, count = ndimage.label(mask, EIGHT)
    return [labels == i + 1 for i in range(count)]


def drop_small(mask: np.ndarray, cells: float) -> np.ndarray:
    """Without the islands of fewer than `cells` cells."""
    labels, count = ndimage.label(mask, EIGHT)
    if count == 0:
        return mask
    size = np.bincount(labels.ravel(), minlength=count + 1)
    keep = size >= cells
    keep[0] = False
    return keep[labels]


def label(mask: np.ndarray) -> np.ndarray:
    """Number of the island (8 neighbours) of every cell, from 1; 0 = not set."""
    labels: np.ndarray = ndimage.label(mask, EIGHT)[0]
    return labels


def highest_near(z: np.ndarray, cells: float) -> np.ndarray:
    """The highest known value within `cells` of every cell; NaN stays NaN."""
    around = ndimage.grey_dilation(np.where(np.isfinite(z), z, -np.inf), footprint=_disc(cells))
    return np.where(np.isfinite(z), around, np.nan)


def drop_spots(height: np.ndarray, area: float, spec: GridSpec) -> np.ndarray:
    """What stands above 0 (m), without islands smaller than `area` (m2); 0 elsewhere and for NaN."""
    positive = np.nan_to_num(height, nan=0.0) > 0
    return np.where(drop_small(positive, area / spec.resolution**2), height, 0.0)


def largest(mask: np.ndarray, spec: GridSpec) -> str:
    """Area of the set cells and the place of the largest island of them, for a person: '12 mm2 at x = ...'."""
    labels, count = ndimage.label(mask, EIGHT)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    at = np.argmax(sizes)
    # the innermost cell of it: the middle of a ring would lie off the ring
    row, col = np.unravel_index(np.argmax(distance_inside(labels == at)), mask.shape)
    area = mask.sum() * spec.resolution**2 * 1e6
    place = f'{area:.3g} mm2' if area < 1000 else f'{area:.0f} mm2'
    more = f' in {count} places, the largest' if count > 1 else ''
    return f'{place}{more} at x = {spec.x[col] * 1e3:.1f} mm, y = {spec.y[row] * 1e3:.1f} mm'


def fill_unknown(z: np.ndarray) -> np.ndarray:
    """NaN replaced by the nearest known value; a map without any known value comes back unchanged."""
    unknown = ~np.isfinite(z)
    if not unknown.any() or unknown.all():
        return z.copy()
    row, col = ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return z[row, col]


def smooth_surface(z: np.ndarray, window: float, keep: float) -> np.ndarray:
    """Surface without its roughness but with its walls, NaN where z is NaN.

    A median over `window` cells followed by a narrow Gaussian; where that moves a cell by more than
    `keep` (m), the cell is at a wall and keeps the median, or its own height if that is too far as well.
    """
    size = 2 * int(round(window / 2)) + 1
    if size < 3:
        return z.copy()
    filled = fill_unknown(z)
    median = ndimage.median_filter(filled, size=size, mode='nearest')
    soft = ndimage.gaussian_filter(median, size / 4, mode='nearest')
    out = np.where(np.abs(soft - median) <= keep / 2, soft, median)
    out = np.where(np.abs(out - filled) <= keep, out, filled)
    return np.where(np.isfinite(z), out, np.nan)


def blur(z: np.ndarray, mask: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian mean over the cells of the mask only (sigma in cells); NaN outside the mask."""
    weight = ndimage.gaussian_filter(mask.astype(float), sigma, mode='constant')
    total = ndimage.gaussian_filter(np.where(mask, z, 0.0), sigma, mode='constant')
    return np.where(mask, total / np.where(mask, weight, 1.0), np.nan)
