"""Filling of small holes, for tools that need closed maps. Only on request; what was filled is marked."""

from __future__ import annotations

import numpy as np

from .quality import enclosed

STEPS = 4000
FILL_TOLERANCE = 1e-8  # m, change per step at which the filling has converged


def fill_holes(z: np.ndarray, resolution: float, largest: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights (rows, cols) m with the enclosed holes up to `largest` (m²) filled, and the mask of what was filled.

    The filling is the membrane over the hole (Laplace's equation with the rim as boundary): no new highs or lows.
    Larger holes and what lies at the border of the grid stay NaN."""
    label, holes = enclosed(np.isfinite(z))
    areas = np.bincount(label.ravel(), minlength=holes + 1) * resolution**2
    small = areas <= largest
    small[0] = False
    mask = small[label]
    out = z.astype(float)
    for number in np.flatnonzero(small):
        rows, cols = np.nonzero(label == number)
        window = np.s_[rows.min() - 1 : rows.max() + 2, cols.min() - 1 : cols.max() + 2]
        out[window] = _membrane(out[window], label[window] == number)
    return out, mask


def _membrane(z: np.ndarray, hole: np.ndarray) -> np.ndarray:
    """z (rows, cols) with the cells of `hole` at the mean of their known or filled neighbours."""
    known = np.isfinite(z) & ~hole
    z = np.where(hole, np.mean(z[known]), z)
    usable = (known | hole)[:, :]
    weight = _neighbours(usable.astype(float))
    values = np.where(usable, z, 0.0)
    for _ in range(STEPS):
        new = _neighbours(values)[hole] / weight[hole]
        change = np.abs(new - values[hole]).max()
        values[hole] = new
        if change < FILL_TOLERANCE:
            break
    return np.where(hole, values, z)


def _neighbours(a: np.ndarray) -> np.ndarray:
    """Sum of the four neighbours; nothing beyond the border."""
    p = np.pad(a, 1)
    return p[:-2, 1:-1] + p[2:, 1:-1] + p[1:-1, :-2] + p[1:-1, 2:]
