"""The grid a quarter of a bead wide that network and bead model work on, whatever the map's resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse

CELLS_PER_BEAD = 4


@dataclass(frozen=True)
class Resampler:
    """Means over coarse cells and linear interpolation back, along rows and columns separately."""

    shape: tuple[int, int]
    rows: tuple[sparse.csr_array, sparse.csr_array]
    cols: tuple[sparse.csr_array, sparse.csr_array]

    @classmethod
    def of(cls, shape: tuple[int, int], resolution: float, cell: float) -> Resampler:
        """From a map of `shape` with cells of `resolution` (m) to coarse cells of `cell` (m)."""
        rows, cols = (_axis(n, round(cell / resolution, 9)) for n in shape)
        return cls((rows[0].shape[0], cols[0].shape[0]), rows, cols)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """values (rows, cols) of the fine grid -> means (shape) over the coarse cells."""
        return (self.cols[0] @ (self.rows[0] @ values).T).T

    def fine(self, values: np.ndarray) -> np.ndarray:
        """values (shape) of the coarse grid -> linear interpolation (rows, cols) on the fine one."""
        return (self.cols[1] @ (self.rows[1] @ values).T).T


@lru_cache(maxsize=16)
def _axis(n: int, factor: float) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Averaging (m, n) and interpolation (n, m) between n cells and m = ceil(n/factor) cells `factor` times as wide."""
    m = max(1, math.ceil(n / factor - 1e-9))
    edges = np.arange(m + 1) * factor
    low, high = np.arange(n)[None, :], np.arange(1, n + 1)[None, :]
    share = np.clip(np.minimum(edges[1:, None], high) - np.maximum(edges[:-1, None], low), 0, None)
    down = share / share.sum(axis=1, keepdims=True)
    at = np.clip((np.arange(n) + 0.5) / factor - 0.5, 0, m - 1)
    left = np.minimum(at.astype(int), max(m - 2, 0))
    up = np.zeros((n, m))
    up[np.arange(n), left] = 1 - (at - left)
    up[np.arange(n), np.minimum(left + 1, m - 1)] += at - left
    return sparse.csr_array(down), sparse.csr_array(up)
