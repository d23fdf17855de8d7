"""Error that a layer will leave, before it is laid: a regression on the surface that it finds and on its plan.

The bead model answers some waves of a surface otherwise than beads do, and a correction that solves through it makes
the same mistake in every layer. The regression is fitted on layers that the closed loop has laid
(`training.residual`). There the setpoints follow from surface and plan, so it needs to know nothing of them, and what
the surface does is not taken for what they do.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from ..grids import Resampler
from ..types import CorrectionInput
from . import plan_geometry
from .model import inner_cells

SCALES = (0.7, 1.4, 2.8, 5.6)  # cells: sigmas that part the bands of the surface
SLOPES = (1.0, 2.0)  # cells: sigmas of the surface whose slope and curvature are looked at
SMOOTH = 1.0  # cells: sigma of what is left, as the regression is fitted
TOLD = 2.0  # cells: sigma of what is told; to act on shorter waves makes other parts than the demo's worse
COUNTED = 0.3  # share of a cell away from the edge from which on its surface is looked at
REACH = 3.0  # sigmas that a mean over the neighbourhood reaches
FAR = 0.6  # layer heights: error of the surface that counts at most
LEAST = 50  # cells of a layer that teaches
MOST = 0.25  # share of the planned height that is told at most
_CHANNELS = tuple(
    i
    for i, name in enumerate(plan_geometry.NAMES)
    if name not in ('footprint', 'thickness', 'temperature')  # the same all over a layer
)
_THICKNESS = plan_geometry.NAMES.index('thickness')
_BANDS = len(SCALES) + 1 + 3 * len(SLOPES)
FIGURES = 2 * _BANDS + len(_CHANNELS) + 2
WEIGHTS = 'residual.weight'  # name in the file of a growth network


class Surface(NamedTuple):
    """A layer before it is laid, on the grid a quarter of a bead wide: counted (rows, cols), weight of a cell; state
    (bands and shape, rows, cols): figures of the surface; x (CHANNELS, rows, cols): of `plan_geometry`; growth
    (rows, cols): what the network predicts."""

    counted: np.ndarray
    state: np.ndarray
    x: np.ndarray
    growth: np.ndarray

    @property
    def thickness(self) -> float:
        """Channel of the plan."""
        return float(self.x[_THICKNESS].flat[0])

    @property
    def inside(self) -> np.ndarray:
        """(rows, cols) bool: the footprint."""
        return self.x[0] > 0


def figures(surface: Surface) -> np.ndarray:
    """(FIGURES, rows, cols) of a layer, as the regression is fitted."""
    thickness, inside = surface.thickness, surface.inside
    plan = [_smooth(surface.x[i], inside, SMOOTH) for i in _CHANNELS]
    growth = _smooth(surface.growth, inside, SMOOTH)
    rest = np.stack([*plan, growth, thickness * growth])
    return np.concatenate([surface.state, thickness * surface.state, rest])


def told(surface: Surface, weights: Mapping[str, np.ndarray]) -> np.ndarray:
    """(rows, cols) share of the planned height that the layer will end too high, its mean apart; 0 from weights without
    a regression."""
    if WEIGHTS not in weights:
        return np.zeros(surface.growth.shape)
    w, thickness = weights[WEIGHTS].astype(float), surface.thickness
    state = w[:_BANDS] + thickness * w[_BANDS : 2 * _BANDS]
    plan = np.zeros(len(surface.x), np.float32)
    plan[list(_CHANNELS)] = w[2 * _BANDS : -2]
    # smoothing is linear: what is smoothed is the sum
    rest = np.tensordot(plan, surface.x, 1) + (w[-2] + thickness * w[-1]) * surface.growth
    found = np.tensordot(state, surface.state, 1) + _smooth(rest, surface.inside, SMOOTH)
    counted = surface.counted
    found = _smooth(found, counted > 0, TOLD)
    found = found - (found * counted).sum() / max(counted.sum(), 1e-9)
    return np.clip(found * counted, -MOST, MOST)


def surface(
    request: CorrectionInput, grid: Resampler, x: np.ndarray, growth: np.ndarray
) -> Surface:
    """Of a request with paths and a footprint, before what identification adds to it. x: of `plan_geometry.build`;
    growth (rows, cols): what the network predicts."""
    inside = x[0] > 0
    error, seen = known_mean(request.error / middle(request), grid)
    counted = inner_cells(request, grid) * (seen & inside)
    counted = np.where(counted > COUNTED, counted, 0.0)
    known = counted > 0
    error = np.where(known, np.clip(error, -FAR, FAR), 0.0)
    along = plan_geometry.travel(request, grid)
    state = np.stack([*_bands(error, known), *_shape(error, known, along)])
    return Surface(counted, state, x, np.where(inside, growth, 0.0))


def moments(surface: Surface, left: np.ndarray) -> np.ndarray | None:
    """(FIGURES + 1, FIGURES + 1): second moments of the figures and, last, of what was left, about their means over the
    layer. left (rows, cols): share of the planned height by which the layer ended too high, NaN = unknown. None when
    too little is known."""
    known = (surface.counted > 0) & np.isfinite(left)
    if known.sum() < LEAST:
        return None
    ended = np.clip(_smooth(left, known, SMOOTH), -FAR, FAR)
    values = np.concatenate([figures(surface), ended[None]])[:, known]
    weight = surface.counted[known] / surface.counted[known].sum()
    values = values - (values @ weight)[:, None]
    return (values * weight) @ values.T


def middle(request: CorrectionInput) -> float:
    """m: planned height in the middle of the footprint, the unit of all figures."""
    return float(np.median(request.planned[request.footprint]))


def known_mean(values: np.ndarray, grid: Resampler) -> tuple[np.ndarray, np.ndarray]:
    """Means of values (rows, cols; NaN = unknown) over the cells of the grid, and where enough is known (bool)."""
    known = np.isfinite(values)
    share = grid.mean(known.astype(float))
    return grid.mean(np.where(known, values, 0.0)) / np.maximum(share, 1e-3), share > 0.1


def _bands(error: np.ndarray, known: np.ndarray) -> list[np.ndarray]:
    """The surface by wave length, the shortest first; they add up to it."""
    blurred = [np.where(known, error, 0.0), *(_smooth(error, known, s) for s in SCALES)]
    return [a - b for a, b in zip(blurred, blurred[1:], strict=False)] + blurred[-1:]


def _shape(error: np.ndarray, known: np.ndarray, along: np.ndarray) -> list[np.ndarray]:
    """Slope along the travel, curvature along and across it, for each of SLOPES."""
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
    return found


def _smooth(values: np.ndarray, known: np.ndarray, sigma: float) -> np.ndarray:
    """Weighted mean (rows, cols) over what is known."""
    total = gaussian_filter(np.where(known, values, 0.0), sigma, truncate=REACH)
    found: np.ndarray = total / _spread(known.tobytes(), known.shape, sigma)
    return found


@lru_cache(maxsize=16)
def _spread(known: bytes, shape: tuple[int, int], sigma: float) -> np.ndarray:
    """What is known is the same in layer after layer."""
    share = np.frombuffer(known, bool).reshape(shape).astype(float)
    return np.maximum(gaussian_filter(share, sigma, truncate=REACH), 1e-3)
