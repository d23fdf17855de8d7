"""How much metal every piece of path must carry so that all of them together lay the planned map.

The melt of each piece spreads over the pool: a half ellipsoid of one bead width that trails the arc a little. Pieces
in turns, at ends and at edges overlap differently from those in the middle of a hatch; dividing the map by the pool's
footprint (Richardson-Lucy iteration) gives each its share. It keeps the total volume and never goes below zero.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import ndimage
from scipy.sparse import csc_array

from waam_plan.fill.path import Pieces
from waam_plan.masks import distance_inside
from waam_plan.settings import MAX_LAYER_RATIO, PlanSettings
from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec

LEAD_OUT = 6e-3  # m before an arc end in which lead_out_metal applies

LEAD_IN = 6e-3  # m after an arc start in which lead_in_metal applies

ROUNDS, ITERATIONS = (
    3,
    4,
)  # of the division; after each round the metal is evened out along the path
SEEN = 0.15  # bead widths: sigma of what `unevenness` looks at
OFFSETS, FINE = 8, 6  # places of a pool in its cell, and parts of a cell, of the table of pools
FOOTPRINT = 6  # cells across a bead, at least, that the division works with
EDGE = (
    0.75  # pitches: a bead whose middle is nearer to the edge of the region than this lies along it
)


def metal_heights(
    pieces: Pieces,
    planned: np.ndarray,
    mask: np.ndarray,
    spec: GridSpec,
    settings: PlanSettings,
    thickest: float | None = None,
) -> np.ndarray:
    """Height (n,) m of every piece; AREA_FACTOR * bead_width * height * length is the metal that it carries (eq 2.16).

    planned: (rows, cols) m, metal wanted on the cells of the mask. The result is limited to half the thinnest and to
    the thickest layer (`thickest`, m; None = of the settings).
    """
    length = pieces.length
    wanted, coarse = _coarser(np.where(mask, planned, 0.0) * spec.resolution**2, spec, settings)
    wanted = _within_reach(pieces, wanted, coarse, settings).ravel()
    spread = footprints(pieces, coarse, settings)
    volume = _evened(length * (spread.T @ wanted) / coarse.resolution**2, pieces, 6)
    for _ in range(ROUNDS):
        for _ in range(ITERATIONS):
            laid = spread @ volume
            ratio = np.divide(wanted, laid, out=np.zeros_like(laid), where=laid > 0)
            volume = volume * (spread.T @ ratio)
        volume = _evened(volume, pieces, 1)
    volume *= wanted.sum() / max(volume.sum(), 1e-18)
    height = volume / (AREA_FACTOR * settings.bead_width * length) * _lead_factor(pieces, settings)
    if settings.edge_share != 1.0:
        height = height * np.where(along_edge(pieces, mask, spec, settings), settings.edge_share, 1)
    thinnest = 0.5 * settings.min_layer * settings.layer_height
    limit = MAX_LAYER_RATIO * settings.layer_height if thickest is None else thickest
    return np.clip(height, thinnest, limit)


def unevenness(
    pieces: Pieces,
    height: np.ndarray,
    planned: np.ndarray,
    spec: GridSpec,
    settings: PlanSettings,
) -> float:
    """RMS of what the pieces lay beside `planned` (rows, cols) m, over its mean; waves much shorter than a bead, which
    every row of beads has, are left out. height: (n,) m."""
    wanted, coarse = _coarser(planned * spec.resolution**2, spec, settings)
    volume = AREA_FACTOR * settings.bead_width * height * pieces.length
    laid = (footprints(pieces, coarse, settings) @ volume).reshape(coarse.shape)
    on = wanted > 0
    blur = SEEN * settings.bead_width / coarse.resolution
    off = waves(laid - wanted, on, blur)[on]
    return float(np.std(off) / wanted[on].mean()) if on.any() else 0.0


def waves(off: np.ndarray, on: np.ndarray, blur: float) -> np.ndarray:
    """Gaussian means (`blur` cells) of `off` (rows, cols) over the cells `on` (bool); 0 away from them."""
    beside, near = (ndimage.gaussian_filter(a, blur) for a in (off * on, on * 1.0))
    return np.divide(beside, near, out=np.zeros_like(beside), where=on)


def edge_surplus(
    pieces: Pieces, height: np.ndarray, mask: np.ndarray, spec: GridSpec, settings: PlanSettings
) -> float:
    """Metal (m3) that the beads along the edge carry beyond what the division gives them. height: (n,) m."""
    if settings.edge_share == 1.0:
        return 0.0
    on = along_edge(pieces, mask, spec, settings)
    metal = AREA_FACTOR * settings.bead_width * float(pieces.length[on] @ height[on])
    return metal * (1 - 1 / settings.edge_share)


def along_edge(
    pieces: Pieces, mask: np.ndarray, spec: GridSpec, settings: PlanSettings
) -> np.ndarray:
    """(n,) whether a piece is part of a bead along the edge of the region."""
    depth = distance_inside(mask) * spec.resolution
    near = np.ones(len(pieces.bead), bool)
    for share in (0.0, 0.5, 1.0):
        at = pieces.start + share * (pieces.end - pieces.start)
        row, col = spec.cell(at[:, 0], at[:, 1])
        row, col = np.clip(row, 0, spec.rows - 1), np.clip(col, 0, spec.cols - 1)
        near &= depth[row, col] < EDGE * settings.bead_width
    return near


def _coarser(
    volume: np.ndarray, spec: GridSpec, settings: PlanSettings
) -> tuple[np.ndarray, GridSpec]:
    """Metal per cell (m3) on cells of at most a FOOTPRINT-th of a bead, which is all that the pool resolves."""
    k = max(1, int(settings.bead_width / FOOTPRINT / spec.resolution + 1e-6))
    rows, cols = -(-spec.rows // k), -(-spec.cols // k)
    padded = np.zeros((rows * k, cols * k))
    padded[: spec.rows, : spec.cols] = volume
    coarse = GridSpec(spec.origin_x, spec.origin_y, spec.resolution * k, rows, cols)
    return padded.reshape(rows, k, cols, k).sum(axis=(1, 3)), coarse


def _within_reach(
    pieces: Pieces, wanted: np.ndarray, spec: GridSpec, settings: PlanSettings
) -> np.ndarray:
    """Metal (rows, cols) m3 without what lies farther than a bead width from every piece.

    Those cells stay without metal instead of having it laid somewhere else.
    """
    t = np.linspace(0, 1, samples(pieces, spec) + 1)[:, None, None]
    at = (pieces.start[:, :2] + t * (pieces.end - pieces.start)[:, :2]).reshape(-1, 2)
    row, col = spec.cell(at[:, 0], at[:, 1])
    on = (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
    empty = np.ones(spec.shape, bool)
    empty[row[on], col[on]] = False
    if empty.all():
        return np.zeros_like(wanted)
    near = ndimage.distance_transform_edt(empty) * spec.resolution <= settings.bead_width
    return np.where(near, wanted, 0.0)


def _evened(volume: np.ndarray, pieces: Pieces, steps: int) -> np.ndarray:
    """Volumes after diffusion along each chain; keeps the sum of every chain."""
    length = pieces.length
    same = pieces.chain[1:] == pieces.chain[:-1]
    mobility = 0.3 * np.minimum(length[1:], length[:-1]) * same
    volume = volume.copy()
    for _ in range(steps):
        flux = mobility * np.diff(volume / length)
        volume[:-1] += flux
        volume[1:] -= flux
    return volume


def samples(pieces: Pieces, spec: GridSpec) -> int:
    """Places per piece from which its metal spreads: about one per cell."""
    return int(np.clip(np.ceil(pieces.length.max(initial=0.0) / spec.resolution / 1.5), 1, 20))


def footprints(pieces: Pieces, spec: GridSpec, settings: PlanSettings) -> csc_array:
    """(cells, pieces) share of each piece's metal that lands on each cell; columns add up to 1 inside the grid."""
    k = samples(pieces, spec)
    places = pool_places(pieces, settings.pool_trail, k)
    table = _pools(settings.bead_width / 2 / spec.resolution)
    u = (places[:, 0] - spec.origin_x) / spec.resolution
    v = (places[:, 1] - spec.origin_y) / spec.resolution
    half = table.shape[-1] // 2
    reach = np.arange(-half, half + 1, dtype=np.int32)
    col, row = (np.floor(at).astype(np.int32)[:, None] + reach for at in (u, v))
    part_u, part_v = (((at - np.floor(at)) * OFFSETS).astype(np.int32) for at in (u, v))
    share = table[part_v, part_u] / k
    share *= ((row >= 0) & (row < spec.rows))[:, :, None]
    share *= ((col >= 0) & (col < spec.cols))[:, None, :]
    row, col = np.clip(row, 0, spec.rows - 1), np.clip(col, 0, spec.cols - 1)
    cell = row[:, :, None] * np.int32(spec.cols) + col[:, None, :]
    begin = np.arange(len(pieces.bead) + 1) * (k * len(reach) ** 2)
    shape = (spec.rows * spec.cols, len(pieces.bead))
    return csc_array((share.ravel(), cell.ravel(), begin.astype(np.int32)), shape=shape)


@lru_cache(maxsize=8)
def _pools(radius: float) -> np.ndarray:
    """(OFFSETS, OFFSETS, m, m) shares of a half ellipsoid of `radius` cells, by the place of its middle in its cell.

    Every entry is the mean over the cell, so that coarse cells lay the same metal as fine ones.
    """
    half = int(radius + 1.5)
    fine = (np.arange((2 * half + 1) * FINE) + 0.5) / FINE - half
    middle = (np.arange(OFFSETS) + 0.5) / OFFSETS
    away = (fine[None] - middle[:, None]) ** 2 / radius**2
    q = np.maximum(1 - away[:, None, :, None] - away[None, :, None, :], 0.0)
    n = 2 * half + 1
    pool = np.sqrt(q).reshape(OFFSETS, OFFSETS, n, FINE, n, FINE).mean(axis=(3, 5))
    return pool / pool.sum(axis=(2, 3), keepdims=True)


def pool_places(pieces: Pieces, trail: float, count: int = 3) -> np.ndarray:
    """(n * count, 2) m: where the pool is while the arc is on each piece, `trail` (m) behind on its chain."""
    t = (np.arange(count) + 0.5) / count
    step = np.linalg.norm((pieces.end - pieces.start)[:, :2], axis=1)
    end = np.cumsum(step)
    origin = _chain_begin(pieces, end - step)
    at = np.maximum((end - step)[:, None] + t * step[:, None] - trail, origin[:, None])
    k = np.clip(np.searchsorted(end, at, 'right'), 0, len(step) - 1)
    share = (at - (end - step)[k]) / np.maximum(step[k], 1e-12)
    a, b = pieces.start[k, :2], pieces.end[k, :2]
    return (a + np.clip(share, 0.0, 1.0)[..., None] * (b - a)).reshape(-1, 2)


def _chain_begin(pieces: Pieces, value: np.ndarray) -> np.ndarray:
    """(n,) the value of the first piece of each piece's chain."""
    first = np.ones(len(value), bool)
    first[1:] = pieces.chain[1:] != pieces.chain[:-1]
    return value[np.flatnonzero(first)][np.cumsum(first) - 1]


def _lead_factor(pieces: Pieces, settings: PlanSettings) -> np.ndarray:
    """Metal factor (n,) of lead-in and lead-out zones at the ends of each chain."""
    factor = np.ones(len(pieces.chain))
    if settings.lead_in_metal == 1.0 and settings.lead_out_metal == 1.0:
        return factor
    length = pieces.length
    middle = np.cumsum(length) - length / 2
    into = middle - _chain_begin(pieces, np.cumsum(length) - length)
    mirror = Pieces(pieces.start[::-1], pieces.end[::-1], pieces.bead[::-1], pieces.chain[::-1])
    back = _chain_begin(mirror, np.cumsum(length)[::-1])[::-1] - middle
    factor[into < LEAD_IN] *= settings.lead_in_metal
    factor[back < LEAD_OUT] *= settings.lead_out_metal
    return factor
