"""Cells of a map where the true surface is known: those beside the worn place that lie on the nominal surface."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

FAR = 4e-3  # m from the place that is restored
LEVEL = 1.5e-3  # m around a cell in which the nominal surface stays within STEP
STEP = 0.3e-3  # m
LIKE = 0.4e-3  # m: what is farther from the nominal surface is something else
APART = 2e-3  # m between cells: nearer ones share their errors
MOST = 600


def known_cells(
    z: np.ndarray, nominal: np.ndarray, region: np.ndarray, cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """(rows, columns) of cells. z, nominal: (rows, cols) m, NaN = unknown; region: bool, metal is laid; cell: m."""
    beside = ndimage.distance_transform_edt(~region) * cell > FAR if region.any() else ~region
    size = 2 * int(np.ceil(LEVEL / cell)) + 1
    known = np.isfinite(nominal)
    high = ndimage.maximum_filter(
        np.where(known, nominal, np.inf), size, mode='constant', cval=np.inf
    )
    low = ndimage.minimum_filter(
        np.where(known, nominal, -np.inf), size, mode='constant', cval=-np.inf
    )
    with np.errstate(invalid='ignore'):
        good = beside & (high - low < STEP) & (np.abs(z - nominal) < LIKE)
    every = max(1, round(APART / cell))
    thinned = np.zeros_like(good)
    thinned[::every, ::every] = True
    rows, columns = np.nonzero(good & thinned)
    some = np.linspace(0, len(rows) - 1, min(len(rows), MOST)).astype(int)
    return rows[some], columns[some]
