"""The beads of a layer, cut into pieces and segments, and the piece nearest to every cell.

The nominal bead model and the channels of the growth network ask for the same of the same paths; the newest are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..grids import CELLS_PER_BEAD

# Bead widths: points closer together bound no segment; points farther apart are corners of a path rather than bounds
# of a setpoint, and the way between is cut into such parts.
SHORT, LONG, PART = 0.25, 1.0, 0.5


class Bead(NamedTuple):
    """One bead, cut into n pieces and m segments. Lengths in m."""

    where: np.ndarray  # (n, 2) x, y of the middles of its pieces
    tangent: np.ndarray  # (n, 2) unit vectors of travel
    way: np.ndarray  # (n,) along the bead, of the middles
    length: float  # of the bead
    bounds: np.ndarray  # (m + 1,) along the bead, where its segments begin and end
    points: np.ndarray  # (m, 3, 2) x, y of start, middle and end of its segments


class Nearest(NamedTuple):
    """Of every cell (rows, cols): number of the nearest piece, counted over all beads, and the distance to it, m."""

    piece: np.ndarray
    far: np.ndarray


def as_bytes(paths: Sequence[np.ndarray]) -> tuple[bytes, ...]:
    """Paths (points, 2) m as `beads_of` and whatever else is kept by them want them."""
    return tuple(np.ascontiguousarray(p, float).tobytes() for p in paths)


@lru_cache(maxsize=4)
def beads_of(paths: tuple[bytes, ...], width: float) -> tuple[Bead, ...]:
    """paths: of every bead, in the order of laying, by `as_bytes`. width: m."""
    return tuple(resampled(np.frombuffer(p).reshape(-1, 2), width) for p in paths)


@lru_cache(maxsize=4)
def nearest_of(paths: tuple[bytes, ...], shape: tuple[int, int], width: float) -> Nearest:
    """paths, width: as of `beads_of`; shape: of the grid a quarter of a bead wide."""
    cell = width / CELLS_PER_BEAD
    y, x = np.meshgrid(*((np.arange(n) + 0.5) * cell for n in shape), indexing='ij')
    where = np.concatenate([b.where for b in beads_of(paths, width)])
    far, piece = cKDTree(where).query(np.stack([x.ravel(), y.ravel()], -1))
    return Nearest(piece.reshape(shape), far.reshape(shape))


def resampled(path: np.ndarray, width: float) -> Bead:
    """A path (points, 2) m cut into pieces of about width/CELLS_PER_BEAD (m), two at least, and into segments."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    n = max(2, round(way[-1] / (width / CELLS_PER_BEAD)))
    at = (np.arange(n) + 0.5) / n * way[-1]

    def place(s: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(s, way, path[:, i]) for i in (0, 1)], -1)

    where = place(at)
    tangent = np.concatenate([where[1:2], where[2:], where[-1:]])
    tangent -= np.concatenate([where[:1], where[:-2], where[-2:-1]])
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-12)[:, None]
    bounds = _segments(way, width)
    points = place(np.stack([bounds[:-1], 0.5 * (bounds[:-1] + bounds[1:]), bounds[1:]], 1))
    return Bead(where, tangent, at, max(way[-1], 1e-9), bounds, points)


def _segments(way: np.ndarray, width: float) -> np.ndarray:
    """Bounds of the segments, m from arc on; way (k,): of the path's points."""
    crossed = np.diff(np.floor(way / (SHORT * width) + 1e-6)) > 0
    bounds = np.concatenate([way[:1], way[1:-1][crossed[:-1]], [max(way[-1], 1e-9)]])
    parts = np.diff(bounds)
    parts = np.where(parts > LONG * width, np.ceil(parts / (PART * width) - 1e-6), 1).astype(int)
    return np.interp(np.arange(parts.sum() + 1), np.concatenate([[0], np.cumsum(parts)]), bounds)
