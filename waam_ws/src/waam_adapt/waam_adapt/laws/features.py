"""What the correction network sees: a `CorrectionInput` on a grid that is a quarter of a bead
wide, in units of bead and layer.

So one network serves all bead widths, layer heights and map resolutions. Training uses the same functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from .. import filters
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import CorrectionInput

NAMES = (
    'error', 'known', 'sigma', 'footprint', 'planned', 'explicit', 'shortfall', 'cos2a', 'sin2a',
    'starts', 'ends', 'paths', 'edge', 'temperature', 'experience',
)  # fmt: skip
CHANNELS = len(NAMES)
LIMIT = 2.0  # of errors in layer heights
END_REACH = 1.0  # bead widths over which the mark of a start or end fades
FAMILIAR = 4  # layers of a direction of travel after which its shortfall counts as known
EDGE_REACH = 2.0  # bead widths from the edge at which a cell counts as interior


@dataclass(frozen=True)
class Features:
    """What the network sees of a layer."""

    x: np.ndarray  # (CHANNELS, rows, cols) float32, on the coarse grid
    height: float  # m, of the planned layer
    resampler: Resampler  # takes coarse maps back to the grid of the request

    def channel(self, name: str) -> np.ndarray:
        """(rows, cols) of the channel called `name` (`NAMES`), on the coarse grid."""
        return self.x[NAMES.index(name)]


def fading(points: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(rows, cols) exp(-distance) from the nearest point (n, 2) (row, col in cells), in units of
    END_REACH beads; 0 without any.
    """
    inside = np.round(points).astype(int).reshape(-1, 2)
    inside = inside[((inside >= 0) & (inside < shape)).all(axis=1)]
    if not len(inside):
        return np.zeros(shape)
    free = np.ones(shape, bool)
    free[inside[:, 0], inside[:, 1]] = False
    return np.exp(-distance_transform_edt(free) / (END_REACH * CELLS_PER_BEAD))


def edge_distance(footprint: np.ndarray) -> np.ndarray:
    """0..1 over the footprint, 1 = EDGE_REACH bead widths or more from its edge."""
    return np.minimum(filters.depth(footprint) / (EDGE_REACH * CELLS_PER_BEAD), 1.0)


def double_angle(direction: tuple[float, float]) -> tuple[float, float]:
    """cos and sin of twice the angle of a direction without sense; (0, 0) stays."""
    n = direction[0] ** 2 + direction[1] ** 2
    if n == 0:
        return 0.0, 0.0
    return (direction[0] ** 2 - direction[1] ** 2) / n, 2 * direction[0] * direction[1] / n


def temperature_feature(temperature: float) -> float:
    """0 for a cold or unknown layer, 1 at 400 degC."""
    return 0.0 if math.isnan(temperature) else float(np.clip((temperature - 20) / 380, 0, 2))


def experience_feature(layers: int) -> float:
    """0 before the shortfall of this direction of travel was ever seen, 1 from FAMILIAR layers on."""
    return min(layers, FAMILIAR) / FAMILIAR


SUMMARIES = (
    'error', 'roughness', 'known share', 'sigma', 'explicit change', 'shortfall', 'planned variation'
)  # fmt: skip


def summary(x: np.ndarray) -> np.ndarray:
    """Figures (len(SUMMARIES),) of one input (CHANNELS, rows, cols) over its footprint, to tell
    what is unlike the training.
    """
    channel = dict(zip(NAMES, x, strict=True))
    inside = channel['footprint'] > 0
    known = inside & (channel['known'] > 0.5)
    if not known.any():
        return np.full(len(SUMMARIES), np.nan)
    error = channel['error']
    rough = (error[1:, 1:] - error[:-1, 1:] - error[1:, :-1] + error[:-1, :-1])[
        known[1:, 1:] & known[:-1, 1:] & known[1:, :-1] & known[:-1, :-1]
    ]

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.square(values, dtype=float)))) if values.size else 0.0

    return np.array([
        rms(error[known]), rms(rough), known.sum() / inside.sum(), float(channel['sigma'][known].mean()),
        rms(channel['explicit'][inside]), rms(channel['shortfall'][known]), rms(channel['planned'][inside]),
    ])  # fmt: skip


def build(request: CorrectionInput, explicit: np.ndarray) -> Features:
    """explicit: (rows, cols) relative change of layer height that the explicit law wishes."""
    footprint = request.footprint
    height = float(np.median(request.planned[footprint]))
    cell = request.bead_width / CELLS_PER_BEAD
    r = Resampler.of(request.z.shape, request.resolution, cell)
    known = footprint & np.isfinite(request.error)
    weight = r.mean(known.astype(float))

    def over_known(values: np.ndarray) -> np.ndarray:
        total = r.mean(np.where(known, values, 0.0))
        return np.where(weight > 0.05, total / np.maximum(weight, 0.05), 0.0)

    sigma = np.full(known.shape, 1e-4) if request.sigma is None else request.sigma
    shortfall = np.zeros(known.shape) if request.shortfall is None else request.shortfall
    inside = r.mean(footprint.astype(float))
    mark = inside > 0.5
    cos2a, sin2a = double_angle(request.direction)
    scale = CELLS_PER_BEAD / request.bead_width
    starts, ends = (
        np.array([(p[i][1], p[i][0]) for p in request.paths]).reshape(-1, 2) * scale - 0.5
        for i in (0, -1)
    )
    planned = r.mean(np.where(footprint, np.nan_to_num(request.planned), 0.0))
    planned = np.where(mark, planned / np.maximum(inside, 0.5) / height - 1, 0.0)
    error = np.clip(over_known(request.error) / height, -LIMIT, LIMIT)
    constant = np.ones(r.shape)
    maps = (
        error, weight * mark, np.clip(over_known(np.nan_to_num(sigma, nan=1e-4)) / height, 0, 1), mark,
        planned, r.mean(explicit) * mark, over_known(shortfall) * mark, cos2a * constant,
        sin2a * constant, fading(starts, r.shape), fading(ends, r.shape),
        constant * bool(request.paths), edge_distance(mark),
        constant * temperature_feature(request.temperature),
        constant * experience_feature(request.experience),
    )  # fmt: skip
    return Features(np.stack(maps).astype(np.float32), height, r)
