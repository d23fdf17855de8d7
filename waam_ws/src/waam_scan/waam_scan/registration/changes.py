"""Metal that was added or taken away between two scans, as distinct from motion."""

from __future__ import annotations

import numpy as np

MODE_BIN = 50e-6  # m
MODE_SHARE = 0.1  # of the highest peak: smaller peaks are not a surface
HALO = 1.0e-3  # m around changed metal that is left out
DENSE = 0.15  # share of changed points around a place from which it has changed: lone spikes do not make a deposit


def unchanged_level(distances: np.ndarray, change: str, reach: float) -> float:
    """Distance (m) of the surface that did not change, from signed distances (n,) within reach (m).

    Among the peaks of their distribution that is the lowest one when metal was added, the highest one when metal is
    missing, otherwise the largest.
    """
    edges = np.arange(-reach, reach + MODE_BIN, MODE_BIN)
    counts = np.histogram(distances, edges)[0].astype(float)
    window = np.hanning(9)[1:-1]
    smooth = np.convolve(counts, window / window.sum(), 'same')
    around = np.lib.stride_tricks.sliding_window_view(np.pad(smooth, 4), 9).max(axis=1)
    peak = np.flatnonzero((smooth >= around) & (smooth > MODE_SHARE * smooth.max()))
    choice = {'growth': peak[0], 'wear': peak[-1], 'any': peak[np.argmax(smooth[peak])]}[change]
    return float(edges[choice] + MODE_BIN / 2)


def changed_places(
    p: np.ndarray, r: np.ndarray, good: np.ndarray, change: str, limit: float
) -> np.ndarray:
    """(n,) bool: points p (n, 3) m near changed metal, its flanks included, which reach below any kernel.

    r: (n,) m signed distances to the reference, good: (n,) which of them count, limit: m, what noise explains.
    Empty when too little would remain for an estimate.
    """
    from scipy.spatial import cKDTree

    over = {'growth': r > limit, 'wear': r < -limit, 'any': np.abs(r) > limit}[change]
    changed = good & over
    nothing = np.zeros(len(p), bool)
    if changed.sum() < 50:
        return nothing
    radius = max(HALO, 4 * mean_spacing(p))
    near = cKDTree(p[changed]).query_ball_point(p, radius, return_length=True, workers=2)
    every = cKDTree(p).query_ball_point(p, radius, return_length=True, workers=2)
    inside = near > DENSE * every
    rest = int((good & ~inside).sum())
    return inside if rest > max(200, 0.02 * good.sum()) else nothing


def mean_spacing(p: np.ndarray) -> float:
    """m, edge of the square that one point has on average, seen along the direction in which the cloud is thinnest."""
    size = np.sort(np.ptp(p, axis=0))
    return float(np.sqrt(size[1] * size[2] / len(p)))
