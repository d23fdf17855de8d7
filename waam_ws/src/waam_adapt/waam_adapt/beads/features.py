"""What the U-Net sees of a layer, on a grid a quarter of a bead wide, in units of bead and layer: the plan
(`beads.plan_geometry`), the error of the surface with its uncertainty, and what the layers of this job have shown.

All channels keep their values when the part is turned or mirrored. Training uses the same functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter

from ..grids import Resampler
from ..types import BeadDeviation, CorrectionInput
from . import plan_geometry
from .model import inner_cells

# cells: sigmas that part the bands of the error, the shortest waves first
SCALES = (0.7, 1.4, 2.8, 5.6)
SLOPES = (1.0, 2.0)  # cells: sigmas of the surface whose slope and curvature are looked at
BANDS = tuple(f'band {k}' for k in range(len(SCALES) + 1))
BENDS = ('slope', 'bend along', 'bend across')
SHAPE = tuple(f'{name} {k}' for k in range(len(SLOPES)) for name in BENDS)
# bands of target - surface by wave length, which add up to it; its slope along the travel and its curvature along and
# across it; what the beads of this job are known to lack here; and, the same all over a layer: layers seen, scatter of
# a layer's efficiency, response of the ends of beads, thickness of the next layer
STATE = (
    *BANDS, *SHAPE, 'seen', 'uncertainty', 'lacking', 'layers', 'scatter', 'response', 'next',
)  # fmt: skip
NAMES = (*plan_geometry.NAMES, *STATE)
CHANNELS = len(NAMES)
MAX_ERROR = 0.8  # layer heights: error that counts at most
COUNTED = 0.3  # share of a cell away from the edge from which on it counts
MANY_LAYERS = 6  # that say as much as more of them
TRUNCATE_SIGMAS = 3.0  # sigmas that a mean over the neighbourhood reaches


def middle(request: CorrectionInput) -> float:
    """m: planned height in the middle of the footprint, the unit of all shares."""
    return float(np.median(request.planned[request.footprint]))


def known_mean(values: np.ndarray, grid: Resampler) -> tuple[np.ndarray, np.ndarray]:
    """Means of values (rows, cols; NaN = unknown) over the cells of the grid, and where enough is known (bool)."""
    known = np.isfinite(values)
    share = grid.mean(known.astype(float))
    return grid.mean(np.where(known, values, 0.0)) / np.maximum(share, 1e-3), share > 0.1


def counted(request: CorrectionInput, grid: Resampler) -> np.ndarray:
    """(rows, cols) weight 0..1 of the cells that are judged: away from the footprint's edge."""
    inner = inner_cells(request, grid)
    return np.where(inner > COUNTED, inner, 0.0)


def build(request: CorrectionInput, grid: Resampler, weight: np.ndarray) -> np.ndarray:
    """(CHANNELS, rows, cols) float32. The request must tell its paths, have a footprint, and be as identification
    prepares it (`learned`). weight (rows, cols): `counted` of the request."""
    plan = plan_geometry.build(request, grid)
    inside = weight * (plan[0] > 0)
    height, deviation = middle(request), request.learned or BeadDeviation(np.zeros(grid.shape))
    error, seen = known_mean(request.error * deviation.scale / height, grid)
    error = np.where(seen & (inside > 0), np.clip(error, -MAX_ERROR, MAX_ERROR), 0.0)
    sigma = np.full(request.z.shape, 1e-4) if request.sigma is None else request.sigma
    sigma, told = known_mean(sigma / height, grid)
    x = np.empty((CHANNELS, *grid.shape), np.float32)
    x[: len(plan)] = plan
    known = inside > 0
    shown = known & seen
    x[len(plan) :] = (
        *_bands(error, shown),
        *_shape(error, shown, plan_geometry.travel(request, grid)),
        shown,
        np.where(told & known, np.minimum(sigma, 1.0), 0.0),
        np.where(known, deviation.missing, 0.0),
        *(np.full(grid.shape, v) for v in _of_the_job(request, deviation, height)),
    )
    return x


def _of_the_job(
    request: CorrectionInput, deviation: BeadDeviation, height: float
) -> tuple[float, float, float, float]:
    """Channels that are the same all over a layer."""
    return (
        min(deviation.layers, MANY_LAYERS) / MANY_LAYERS,
        10 * deviation.scatter,
        deviation.response,
        request.next_thickness / height,
    )


def unlike(x: np.ndarray, width: float, seen: Mapping[str, list[float]]) -> str:
    """The first figure of a plan (`plan_geometry.summary`) that lies outside of what the training has seen, in words;
    '' = none. width: m, of a bead."""
    figures = plan_geometry.summary(x[: plan_geometry.CHANNELS], width)
    for name, value in zip(plan_geometry.SUMMARIES, figures, strict=True):
        low, high = seen[name]
        if not low <= value <= high:
            return f'{name} {value:.3g}, seen {low:.3g} .. {high:.3g}'
    return ''


def _bands(error: np.ndarray, known: np.ndarray) -> list[np.ndarray]:
    blurred = [error, *(_smooth(error, known, s) for s in SCALES)]
    return [np.where(known, a - b, 0.0) for a, b in pairwise(blurred)] + [
        np.where(known, blurred[-1], 0.0)
    ]


def _shape(error: np.ndarray, known: np.ndarray, along: np.ndarray) -> list[np.ndarray]:
    """along (2, rows, cols): direction of travel, x and y."""
    found = []
    length = np.maximum((along**2).sum(axis=0), 1e-6)
    x, y = along
    for sigma in SLOPES:
        dy, dx = np.gradient(_smooth(error, known, sigma))
        dyy, dyx = np.gradient(dy)
        dxx = np.gradient(dx, axis=1)
        found += [
            dx * x + dy * y,
            (dxx * x**2 + dyy * y**2 + 2 * dyx * x * y) / length,
            (dxx * y**2 + dyy * x**2 - 2 * dyx * x * y) / length,
        ]
    return [np.where(known, v, 0.0) for v in found]


def _smooth(values: np.ndarray, known: np.ndarray, sigma: float) -> np.ndarray:
    """Weighted mean (rows, cols) over what is known."""
    total = gaussian_filter(np.where(known, values, 0.0), sigma, truncate=TRUNCATE_SIGMAS)
    found: np.ndarray = total / _spread(known.tobytes(), known.shape, sigma)
    return found


@lru_cache(maxsize=16)
def _spread(known: bytes, shape: tuple[int, int], sigma: float) -> np.ndarray:
    """What is known is the same in layer after layer."""
    share = np.frombuffer(known, bool).reshape(shape).astype(float)
    return np.maximum(gaussian_filter(share, sigma, truncate=TRUNCATE_SIGMAS), 1e-3)
