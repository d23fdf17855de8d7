"""How much metal every piece of path must carry so that all of them together lay the planned map.

The melt of each piece spreads over the pool: a half ellipsoid of one bead width that trails the arc a little. Pieces
in turns, at ends and at edges overlap differently from those in the middle of a hatch; dividing the map by the pool's
footprint (Richardson-Lucy iteration) gives each its share. It keeps the total volume and never goes below zero.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from waam_plan.path import Pieces, nearest_piece
from waam_plan.settings import SECTION, PlanSettings
from waam_process.grid import GridSpec

ROUNDS, ITERATIONS = (
    3,
    4,
)  # of the division; after each round the metal is evened out a little along the path
SAMPLES = 3  # places per piece from which its metal spreads


def metal_heights(
    pieces: Pieces, planned: np.ndarray, mask: np.ndarray, spec: GridSpec, settings: PlanSettings
) -> np.ndarray:
    """Height (n,) m of every piece; SECTION * bead_width * height * length is the metal that it carries (eq 2.17).

    planned: (rows, cols) m, metal wanted on the cells of the mask. The result is limited to half the thinnest and to
    the thickest layer.
    """
    length = pieces.length
    wanted, first = _within_reach(pieces, planned, mask, spec, settings)
    volume = _evened(first, pieces, 6)
    spread = footprints(pieces, spec, settings)
    for _ in range(ROUNDS):
        for _ in range(ITERATIONS):
            laid = spread @ volume
            ratio = np.divide(wanted, laid, out=np.zeros_like(laid), where=laid > 0)
            volume = volume * (spread.T @ ratio)
        volume = _evened(volume, pieces, 1)
    volume *= wanted.sum() / max(volume.sum(), 1e-18)
    height = volume / (SECTION * settings.bead_width * length) * _lead_factor(pieces, settings)
    thinnest = 0.5 * settings.min_layer * settings.layer_height
    return np.clip(height, thinnest, settings.max_layer_ratio * settings.layer_height)


def _within_reach(
    pieces: Pieces, planned: np.ndarray, mask: np.ndarray, spec: GridSpec, settings: PlanSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Metal (cells,) that some piece can lay, m3, and a first guess: each cell's goes to the nearest piece (n,).

    Cells farther than a bead width from every piece stay without metal instead of being laid somewhere else.
    """
    row, col = np.nonzero(mask)
    index, distance = nearest_piece(pieces, spec.x[col], spec.y[row], spec.resolution)
    near = distance <= settings.bead_width
    row, col, index = row[near], col[near], index[near]
    wanted = np.zeros(spec.shape)
    wanted[row, col] = planned[row, col] * spec.resolution**2
    return wanted.ravel(), np.bincount(index, wanted[row, col], len(pieces.bead))


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


def footprints(pieces: Pieces, spec: GridSpec, settings: PlanSettings) -> csr_array:
    """(cells, pieces) share of each piece's metal that lands on each cell; columns add up to 1 inside the grid."""
    places = pool_places(pieces, settings.pool_trail)
    radius = settings.bead_width / 2 / spec.resolution
    uv = (places - (spec.origin_x, spec.origin_y)) / spec.resolution
    base = np.floor(uv).astype(np.int64)
    reach = np.arange(-int(radius) - 1, int(radius) + 2)
    dv, du = (d.ravel() for d in np.meshgrid(reach, reach, indexing='ij'))
    col, row = base[:, :1] + du, base[:, 1:] + dv
    q = 1 - ((col + 0.5 - uv[:, :1]) ** 2 + (row + 0.5 - uv[:, 1:]) ** 2) / radius**2
    share = np.sqrt(np.maximum(q, 0.0))
    share /= SAMPLES * share.sum(axis=1, keepdims=True)
    piece = np.repeat(np.arange(len(pieces.bead)), SAMPLES)[:, None] + 0 * col
    keep = (share > 0) & (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
    cell = (row * spec.cols + col)[keep]
    shape = (spec.rows * spec.cols, len(pieces.bead))
    return csr_array((share[keep], (cell, piece[keep])), shape=shape)


def pool_places(pieces: Pieces, trail: float) -> np.ndarray:
    """(n * SAMPLES, 2) m: where the pool is while the arc is on each piece, `trail` (m) behind on its chain."""
    t = (np.arange(SAMPLES) + 0.5) / SAMPLES
    out = np.empty((len(pieces.bead), SAMPLES, 2))
    for number in np.unique(pieces.chain):
        of = np.flatnonzero(pieces.chain == number)
        corners = np.concatenate([pieces.start[of[:1], :2], pieces.end[of, :2]])
        step = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(step)])
        at = np.maximum(along[:-1, None] + t * step[:, None] - trail, 0.0)
        out[of] = np.stack([np.interp(at, along, corners[:, i]) for i in range(2)], axis=-1)
    return out.reshape(-1, 2)


def _lead_factor(pieces: Pieces, settings: PlanSettings) -> np.ndarray:
    """Metal factor (n,) of lead-in and lead-out zones at the ends of each chain."""
    factor = np.ones(len(pieces.chain))
    if settings.lead_in_metal == 1.0 and settings.lead_out_metal == 1.0:
        return factor
    length = pieces.length
    for number in np.unique(pieces.chain):
        of = np.flatnonzero(pieces.chain == number)
        middle = np.cumsum(length[of]) - length[of] / 2
        factor[of[middle < settings.lead_in]] *= settings.lead_in_metal
        factor[of[middle > length[of].sum() - settings.lead_out]] *= settings.lead_out_metal
    return factor
