"""Nominal model of a layer: what every piece of its beads adds to the cells of a grid a quarter of a bead wide.

Across a bead its metal is shared out by a Gaussian, along it by the length of the melt pool; a segment smears what is
asked along the bead, and what is asked arrives late along the travel (`BeadModel.growth`, `lag`). Nothing of a plant is
in it but the bead width that the controller believes in. The plan is taken to give the plan: every row sums to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from . import filters
from .grids import CELLS_PER_BEAD, Resampler

SPREAD, POOL, SEGMENT = 0.33, 0.2, 0.5  # bead widths: sigma across and along, length of a segment
REACH = 4  # cells on each side of a piece that its metal can touch
ALONE = 0.9  # share of the metal of a cell that belongs to one bead where beads do not overlap
TINY = 5e-3  # share of a piece's metal that is left out
MARGIN = 0.3  # bead widths at the edge of a part that are not looked at: the flank is no level
COVERED = 0.3  # a cell that the beads give less of a layer than this has no row


@dataclass(frozen=True)
class BeadModel:
    """n pieces along the beads of a layer, in the order they are laid.

    spread (cells, n): relative growth of the cells for the relative metal of the pieces. where (n, 2): x, y in m.
    first, last (n,): pieces at the ends of the same bead. step (n,): length of a piece, m. to_arc (n,): distance to the
    nearer end of the bead, m. Of every cell (rows, cols): nearest: piece that it belongs to; ahead: by how many pieces
    it lies ahead of its middle; near: less than a bead away from it; arc: its to_arc. overlapped: most cells get metal
    of more than one bead.
    """

    shape: tuple[int, int]
    width: float
    spread: sparse.csr_array
    where: np.ndarray
    first: np.ndarray
    last: np.ndarray
    step: np.ndarray
    to_arc: np.ndarray
    nearest: np.ndarray
    ahead: np.ndarray
    near: np.ndarray
    overlapped: bool

    @property
    def arc(self) -> np.ndarray:
        return self.to_arc[self.nearest]

    def growth(self, asked: np.ndarray, lag: float) -> np.ndarray:
        """(rows, cols) relative growth for the relative metal (n,) that is asked of the pieces."""
        columns, shares = self._sources(lag)
        return (self.spread @ (shares * asked[columns]).sum(axis=1)).reshape(self.shape)

    def driven(self, lag: float) -> sparse.csr_array:
        """(n, n) what reaches the metal of the pieces of what is asked of them, `lag` m late along the travel."""
        columns, shares = self._sources(lag)
        n, k = columns.shape
        return sparse.csr_array(
            (shares.ravel(), columns.ravel(), np.arange(0, n * k + 1, k)), shape=(n, n)
        )

    def _sources(self, lag: float) -> tuple[np.ndarray, np.ndarray]:
        """Pieces (n, k) and their shares (n, k) in the mean over a segment around the place `lag` m before every piece;
        what a bead begins and ends with goes on."""
        half = 0.5 * SEGMENT * CELLS_PER_BEAD
        offsets = np.arange(-int(half) - 1, int(half) + 3)
        late = -lag / self.step
        low = np.floor(late)
        share = np.clip(half + 0.5 - np.abs(offsets[:-1]), 0.0, 1.0)
        share = np.append(share, 0.0) / share.sum()
        part = (late - low)[:, None]
        shares = (1 - part) * share + part * np.roll(share, 1)
        columns = np.arange(len(low))[:, None] + offsets + low[:, None].astype(int)
        return np.clip(columns, self.first[:, None], self.last[:, None]), shares

    def on_cells(self, pieces: np.ndarray) -> np.ndarray:
        """(rows, cols) values (n,) of the nearest bead, linear between its pieces."""
        i = self.nearest
        other = np.clip(i + np.sign(self.ahead).astype(int), self.first[i], self.last[i])
        return pieces[i] + np.abs(self.ahead) * (pieces[other] - pieces[i])

    def at_pieces(self, values: np.ndarray, resolution: float) -> np.ndarray:
        """(n,) the cells of a map (rows, cols) of any resolution under the pieces."""
        cells = np.floor(self.where / resolution).astype(int)
        cols, rows = (np.clip(cells[:, i], 0, values.shape[1 - i] - 1) for i in (0, 1))
        return values[rows, cols]


def bead_model(paths: Sequence[np.ndarray], shape: tuple[int, int], width: float) -> BeadModel:
    """paths: beads from arc on to arc off, (n, 2) m from the corner of cell (0, 0). shape: of the grid a quarter of a
    bead wide. width: m. The newest models are kept: layers come back in the same two directions."""
    return _cached(tuple(np.ascontiguousarray(p, float).tobytes() for p in paths), shape, width)


@lru_cache(maxsize=4)
def _cached(paths: tuple[bytes, ...], shape: tuple[int, int], width: float) -> BeadModel:
    beads = [_pieces(np.frombuffer(p).reshape(-1, 2), width / CELLS_PER_BEAD) for p in paths]
    where, tangent, step, along, rest = (np.concatenate(c) for c in zip(*beads, strict=True))
    counts = [len(b[0]) for b in beads]
    begin = np.concatenate([[0], np.cumsum(counts)[:-1]])
    nearest, ahead, near = _nearest(where, tangent / step[:, None], shape, width / CELLS_PER_BEAD)
    spread = _spread(where, tangent, step, shape, width)
    return BeadModel(
        shape, width, spread, where, np.repeat(begin, counts),
        np.repeat(begin + counts - 1, counts), step, np.minimum(along, rest), nearest, ahead, near,
        _overlapped(spread, np.repeat(np.arange(len(counts)), counts)),
    )  # fmt: skip


def _pieces(path: np.ndarray, length: float) -> tuple[np.ndarray, ...]:
    """Middles (n, 2) of the pieces of a bead, their tangents (n, 2), length (n,), ways from arc on and to arc off."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    n = max(2, round(way[-1] / length))
    at = (np.arange(n) + 0.5) / n * way[-1]
    where = np.stack([np.interp(at, way, path[:, i]) for i in (0, 1)], 1)
    tangent = np.gradient(where, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-12)[:, None]
    return where, tangent, np.full(n, max(way[-1], 1e-9) / n), at, way[-1] - at


def _spread(
    where: np.ndarray, tangent: np.ndarray, step: np.ndarray, shape: tuple[int, int], width: float
) -> sparse.csr_array:
    """(cells, n); rows that get too little metal are empty, the others sum to 1."""
    cell = width / CELLS_PER_BEAD
    side = np.arange(-REACH, REACH + 1)
    offsets = np.stack(np.meshgrid(side, side, indexing='ij'), -1).reshape(-1, 2)
    offsets = offsets[np.hypot(*offsets.T) <= REACH + 0.5]
    cells = np.floor(where[:, ::-1] / cell).astype(int)[:, None, :] + offsets
    y, x = (((cells[..., i] + 0.5) * cell - where[:, 1 - i, None]) / width for i in (0, 1))
    along = x * tangent[:, :1] + y * tangent[:, 1:]
    across = x * tangent[:, 1:] - y * tangent[:, :1]
    weight = np.exp(-0.5 * ((along / POOL) ** 2 + (across / SPREAD) ** 2))
    weight *= (step / weight.sum(1))[:, None]
    good = (cells >= 0).all(-1) & (cells < shape).all(-1) & (weight > TINY * step[:, None])
    rows = (cells[..., 0] * shape[1] + cells[..., 1])[good]
    columns = np.broadcast_to(np.arange(len(step))[:, None], good.shape)[good]
    size = shape[0] * shape[1]
    metal = sparse.csr_array((weight[good], (rows, columns)), shape=(size, len(step)))
    total = np.asarray(metal.sum(axis=1)).ravel()
    enough = total > COVERED * np.median(total[total >= 0.5 * total.max()])
    scale = np.where(enough, 1 / np.where(enough, total, 1.0), 0.0)
    return (sparse.diags_array(scale) @ metal).tocsr()


def _overlapped(spread: sparse.csr_array, bead: np.ndarray) -> bool:
    """bead (n,): number of the bead of every piece."""
    one = sparse.csr_array((np.ones(len(bead)), (np.arange(len(bead)), bead)))
    most = (spread @ one).max(axis=1).toarray()
    return bool(most.any() and np.median(most[most > 0]) < ALONE)


def _nearest(
    where: np.ndarray, pace: np.ndarray, shape: tuple[int, int], cell: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest piece of every cell, by how many pieces the cell lies ahead of its middle, and whether it is less than a
    bead away. pace (n, 2): pieces per m of travel.
    """
    rows, cols = ((np.arange(n) + 0.5) * cell for n in shape)
    y, x = np.meshgrid(rows, cols, indexing='ij')
    cells = np.stack([x, y], -1)
    far, i = (a.reshape(shape) for a in cKDTree(where).query(cells.reshape(-1, 2)))
    ahead = np.clip(((cells - where[i]) * pace[i]).sum(-1), -1.0, 1.0)
    return i, ahead, far < CELLS_PER_BEAD * cell


def inner_mean(
    values: np.ndarray, known: np.ndarray, footprint: np.ndarray, grid: Resampler, margin: float
) -> tuple[np.ndarray, np.ndarray]:
    """Means over the cells of the model's grid of what is known and `margin` cells from the footprint's edge, and the
    share (rows, cols) of the cells that this is. Shares of cells count, so the map's resolution does not."""
    share = np.where(known, filters.inner_share(footprint, margin), 0.0)
    weight = grid.mean(share)
    total = grid.mean(np.where(share > 0, share * np.where(known, values, 0.0), 0.0))
    return np.where(weight > TINY, total / np.maximum(weight, TINY), 0.0), weight
