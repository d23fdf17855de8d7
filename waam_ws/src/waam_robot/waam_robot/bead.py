"""A path of the torch at even steps, with its corners rounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FINE = 2e-5  # m: step while corners are rounded
MAX_POINTS = 2_000_000


@dataclass(frozen=True)
class Bead:
    """points: (N, 3) m; way: (N,) arc length, m, rising."""

    points: np.ndarray
    way: np.ndarray

    @property
    def length(self) -> float:
        return float(self.way[-1])


def make_bead(points: np.ndarray, step: float = 0.1e-3, corner: float = 0.5e-3) -> Bead:
    """The bead along a polyline (M, 3).

    Corners are rounded by a mean over `corner` (m) to both sides, weighted towards the middle: a right angle is cut by
    0.24 of it, straight stretches stay, both ends stay. ValueError for a path without length or with values that are
    not finite.
    """
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise ValueError(f'a bead has points of shape (M, 3), M > 1, not {points.shape}')
    if not np.isfinite(points).all():
        raise ValueError('a bead has a value that is not finite')
    if not (step > 0 and corner >= 0):
        raise ValueError(f'step {step}, corner {corner}: wanted positive lengths')
    given = way_along(points)
    if not given[-1] > 1e-6:
        raise ValueError(f'a bead of {given[-1] * 1e3:.4f} mm')
    if given[-1] / min(step, FINE) > MAX_POINTS:
        raise ValueError(
            f'a bead of {given[-1]:.1f} m; at most {MAX_POINTS * min(step, FINE):.0f} m'
        )
    keep = np.concatenate([[True], np.diff(given) > 0])
    fine = np.linspace(0, given[-1], max(int(np.ceil(given[-1] / FINE)), 2) + 1)
    smooth = _rounded(at_ways(given[keep], points[keep], fine), int(corner / FINE))
    way = way_along(smooth)
    even = np.linspace(0, way[-1], max(int(np.ceil(way[-1] / step)), 3) + 1)
    return Bead(at_ways(way, smooth, even), even)


def way_along(points: np.ndarray) -> np.ndarray:
    """(N,) m: length from the first of points (N, 3) m."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def at_ways(way: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(k, 3): values (N, 3) at the lengths `wanted` (k,), between those at `way` (N,), rising."""
    return np.stack([np.interp(wanted, way, values[:, n]) for n in range(3)], axis=1)


def _rounded(values: np.ndarray, half: int) -> np.ndarray:
    """Weighted mean over `half` samples to both sides, less near the ends; straight and even stretches stay."""
    if half < 1:
        return values
    half = min(half, (len(values) - 1) // 2)
    weight = np.concatenate([np.arange(1, half + 1), np.arange(half - 1, 0, -1)]).astype(float)
    weight /= weight.sum()
    before = 2 * values[0] - values[half:0:-1]  # mirrored at the end, so that the end stays
    after = 2 * values[-1] - values[-2 : -half - 2 : -1]
    padded = np.concatenate([before, values, after])
    wide = np.stack(
        [np.convolve(padded[:, n], weight, 'same') for n in range(values.shape[1])], axis=1
    )
    return np.asarray(wide[half : half + len(values)])
