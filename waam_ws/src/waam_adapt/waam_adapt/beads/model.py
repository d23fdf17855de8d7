"""Nominal model of a layer: what every setpoint of its beads adds to the cells of a grid a quarter of a bead wide.

A setpoint holds along its segment, from one point of a told path to the next, and arrives late along the travel
(`BeadModel.driven`, `lag`). Across a bead its metal is shared out by a Gaussian, along it by the length of the melt
pool. Nothing of a plant is in it but the bead width that the controller believes in. The plan is taken to give the
plan: every row sums to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import sparse

from .. import filters
from ..feed.feed_forward import WEIGHTS
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import CorrectionInput
from . import kernels
from .bead_path import Bead, as_bytes, beads_of, nearest_of

SPREAD, POOL = 0.33, 0.2  # bead widths: sigma across and along
GAP = 4.0  # bead widths between the beads of a layer laid end to end
MAX_METAL_CELLS = 4  # cells on each side of a piece that its metal can touch
ALONE = 0.9  # share of the metal of a cell that belongs to one stretch where beads do not overlap
STRETCH = 2.0  # bead widths of a bead that count as one when it is asked whether beads overlap
TINY = 5e-3  # share of a piece's metal that is left out
MARGIN = 0.25  # bead widths at the edge of a part that are not looked at: the flank is no level
COVERED = 0.3  # a cell that the beads give less of a layer than this has no row


@dataclass(frozen=True)
class BeadModel:
    """n pieces of metal along the beads of a layer and m segments whose setpoints drive them, in the order of laying.

    The beads lie end to end along one coordinate, in m; the gaps between them belong to the segments beside them.
    """

    shape: tuple[int, int]  # rows and columns of the grid
    width: float  # m, of a bead
    # (cells, n) relative growth of the cells for the relative metal of the pieces
    spread: sparse.csr_array
    pieces: np.ndarray  # (n, 2) m along all beads, where pieces begin and end
    bounds: np.ndarray  # (m + 1,) m along all beads, where segments begin and end
    points: np.ndarray  # (m, 3, 2) m, x and y of start, middle and end of the segments
    # (m, m) what the feed-forward makes of a map that is linear from middle to middle
    read: sparse.csr_array
    first: np.ndarray  # (m,) number of the first segment of the same bead
    last: np.ndarray  # (m,) number of its last segment
    to_arc: np.ndarray  # (m,) m from the middle of a segment to the nearer end of its bead
    low: np.ndarray  # (rows, cols) segment whose middle comes before the cell,
    high: np.ndarray  # (rows, cols) and the one whose middle comes after it
    share: np.ndarray  # (rows, cols) 0..1, how far the cell lies from low to high
    near: np.ndarray  # (rows, cols) bool, a bead passes less than a bead width away
    arc: np.ndarray  # (rows, cols) m to the nearer end of its bead
    # (rows, cols) pieces after arc on, from 1, or before arc off, negative; the nearer one
    end: np.ndarray
    overlapped: bool  # most cells get metal of more than one pass

    def growth(self, asked: np.ndarray, lag: float) -> np.ndarray:
        """(rows, cols) relative growth for the relative metal (m,) that the setpoints ask for."""
        return (self.spread @ (self.driven(lag) @ asked)).reshape(self.shape)

    def driven(self, lag: float) -> sparse.csr_array:
        """(n, m) metal of the pieces for that of the setpoints, `lag` m late along the travel."""
        begin, end = self.pieces.T - lag
        segment = np.searchsorted(self.bounds, begin, 'right') - 1
        segment = np.clip(segment, 0, len(self.bounds) - 2)
        after = np.searchsorted(self.bounds, end, 'left')
        columns = segment[:, None] + np.arange(max(1, int((after - segment).max())))
        columns = np.minimum(columns, len(self.bounds) - 2)
        low = np.maximum(begin[:, None], self.bounds[columns])
        high = np.minimum(end[:, None], self.bounds[columns + 1])
        shares = np.maximum(high - low, 0.0)
        shares[:, 1:][columns[:, 1:] == columns[:, :-1]] = 0.0
        shares /= shares.sum(axis=1, keepdims=True)
        n, k = columns.shape
        shape = n, len(self.bounds) - 1
        return sparse.csr_array(
            (shares.ravel(), columns.ravel(), np.arange(0, n * k + 1, k)), shape
        )

    def on_cells(self, asked: np.ndarray) -> np.ndarray:
        """(rows, cols) values (m,) of the nearest bead, linear from the middle of a segment to that of the next."""
        return asked[self.low] + self.share * (asked[self.high] - asked[self.low])

    def of_cells(self, values: np.ndarray, resolution: float) -> np.ndarray:
        """(m,) what the feed-forward reads from a map (rows, cols) of any resolution; NaN is left out, 1 without any
        value."""
        cells = np.floor(self.points / resolution).astype(int)
        cols, rows = (np.clip(cells[..., i], 0, values.shape[1 - i] - 1) for i in (0, 1))
        read = values[rows, cols]
        weight = np.where(np.isfinite(read), WEIGHTS, 0.0)
        total, found = weight.sum(axis=1), (weight * np.nan_to_num(read)).sum(axis=1)
        return np.where(total > 0, found / np.where(total > 0, total, 1.0), 1.0)


def bead_model(paths: Sequence[np.ndarray], shape: tuple[int, int], width: float) -> BeadModel:
    """paths: beads from arc on to arc off, (n, 2) m from the corner of cell (0, 0), with the points between which
    setpoints hold. shape: of the grid a quarter of a bead wide. width: m. The newest models are kept: layers come back
    in the same two directions."""
    return _cached(as_bytes(paths), shape, width)


@lru_cache(maxsize=4)
def _cached(paths: tuple[bytes, ...], shape: tuple[int, int], width: float) -> BeadModel:
    beads = beads_of(paths, width)
    cell, gap = width / CELLS_PER_BEAD, GAP * width
    pieces, segments = (
        _Groups.of(some) for some in ([b.way for b in beads], [b.points for b in beads])
    )
    length = np.array([b.length for b in beads])
    offset = np.cumsum(length + gap) - length
    where, tangent, way = (np.concatenate([getattr(b, k) for b in beads]) for k in Bead._fields[:3])
    step, run = (length / pieces.counts)[pieces.group], way + offset[pieces.group]
    bounds = [b.bounds + o for b, o in zip(beads, offset, strict=True)]
    middle = np.concatenate([0.5 * (b[1:] + b[:-1]) for b in bounds])
    to_arc, arc = (
        np.minimum(w, length[g.group] - w)
        for w, g in ((middle - offset[segments.group], segments), (way, pieces))
    )
    spread = _spread(where, tangent, step, shape, width)
    i, far = nearest_of(paths, shape, width)
    ahead = _ahead(i, where, tangent / step[:, None], cell)
    bead = pieces.group[i]
    at = np.interp(run[i] + ahead * step[i], middle, np.arange(len(middle)))
    at = np.clip(at, segments.begin[bead], segments.end[bead] - 1)
    low = at.astype(int)
    return BeadModel(
        shape=shape,
        width=width,
        spread=spread,
        pieces=np.stack([run - 0.5 * step, run + 0.5 * step], 1),
        bounds=np.concatenate([[0.0], *([*b[1:-1], b[-1] + 0.5 * gap] for b in bounds)]),
        points=np.concatenate([b.points for b in beads]),
        read=_read(bounds),
        first=segments.begin[segments.group],
        last=segments.end[segments.group] - 1,
        to_arc=to_arc,
        low=low,
        high=np.minimum(low + 1, segments.end[bead] - 1),
        share=at - low,
        near=far < CELLS_PER_BEAD * cell,
        arc=arc[i],
        end=pieces.from_ends()[i],
        overlapped=_overlapped(spread, run, width),
    )


class _Groups(NamedTuple):
    """Elements of beads, one bead after the other."""

    counts: np.ndarray  # (beads,) elements of each bead
    begin: np.ndarray  # (beads,) number of its first element
    end: np.ndarray  # (beads,) number after its last element
    group: np.ndarray  # (elements,) bead of each

    @classmethod
    def of(cls, parts: Sequence[np.ndarray]) -> _Groups:
        """parts: one array per bead, with a row for each of its elements."""
        counts = np.array([len(p) for p in parts])
        end = np.cumsum(counts)
        return cls(counts, end - counts, end, np.repeat(np.arange(len(counts)), counts))

    def from_ends(self) -> np.ndarray:
        """(elements,) number from the beginning of the bead, 1 first, or from its end, negative; the smaller one."""
        i = np.arange(len(self.group))
        on, off = i - self.begin[self.group] + 1, self.end[self.group] - i
        return np.where(on <= off, on, -off)


def _read(beads: list[np.ndarray]) -> sparse.csr_array:
    """See `BeadModel.read`; bounds of the segments of every bead, m."""
    length = np.concatenate([np.diff(b) for b in beads])
    linked = np.ones(len(length) - 1)  # to the next one; 0 from bead to bead
    linked[np.cumsum([len(b) - 1 for b in beads])[:-1] - 1] = 0.0
    next_one = length[:-1] / (length[:-1] + length[1:])  # share of the next one at the bound
    own = np.full(len(length), WEIGHTS[1])
    own += WEIGHTS[2] * np.append(np.where(linked, 1 - next_one, 1.0), 1.0)
    own += WEIGHTS[0] * np.append(1.0, np.where(linked, next_one, 1.0))
    beside = [WEIGHTS[0] * (1 - next_one) * linked, WEIGHTS[2] * next_one * linked]
    return sparse.diags_array([beside[0], own, beside[1]], offsets=[-1, 0, 1], format='csr')


def _spread(
    where: np.ndarray, tangent: np.ndarray, step: np.ndarray, shape: tuple[int, int], width: float
) -> sparse.csr_array:
    """(cells, n); rows that get too little metal are empty, the others sum to 1."""
    cell, size = width / CELLS_PER_BEAD, shape[0] * shape[1]
    metal, cells, first = kernels.shares(
        place=where[:, ::-1] / cell,
        tangent=tangent,
        step=step,
        rows=shape[0],
        cols=shape[1],
        reach=MAX_METAL_CELLS,
        along=POOL * CELLS_PER_BEAD,
        across=SPREAD * CELLS_PER_BEAD,
        tiny=TINY,
    )
    total = np.bincount(cells, metal, size)
    enough = total > COVERED * np.median(total[total >= 0.5 * total.max()])
    metal *= np.where(enough, 1 / np.where(enough, total, 1.0), 0.0)[cells]
    return sparse.csc_array((metal, cells, first), shape=(size, len(step))).tocsr()


def _overlapped(spread: sparse.csr_array, run: np.ndarray, width: float) -> bool:
    """run (n,): m along all beads of every piece. A zig-zag overlaps itself without ever putting the arc out, so
    stretches of the way are compared and not beads."""
    _, stretch = np.unique(np.floor(run / (STRETCH * width)), return_inverse=True)
    one = sparse.csr_array((np.ones(len(run)), (np.arange(len(run)), stretch)))
    most = (spread @ one).max(axis=1).toarray()
    return bool(most.any() and np.median(most[most > 0]) < ALONE)


def _ahead(i: np.ndarray, where: np.ndarray, pace: np.ndarray, cell: float) -> np.ndarray:
    """(rows, cols) by how many pieces every cell lies ahead of the middle of its nearest one, i, -1 .. 1.
    pace (n, 2): pieces per m of travel."""
    rows, cols = ((np.arange(n) + 0.5) * cell for n in i.shape)
    x = (cols[None, :] - where[i, 0]) * pace[i, 0]
    y = (rows[:, None] - where[i, 1]) * pace[i, 1]
    return np.clip(x + y, -1.0, 1.0)


def inner_cells(request: CorrectionInput, grid: Resampler) -> np.ndarray:
    """(rows, cols) share of the cells of the model's grid that lie away from the footprint's edge: what solver and
    networks look at."""
    margin = MARGIN * request.bead_width / request.resolution
    return grid.mean(filters.inner_share(request.footprint, margin))


def inner_mean(
    values: np.ndarray, known: np.ndarray, footprint: np.ndarray, grid: Resampler, margin: float
) -> tuple[np.ndarray, np.ndarray]:
    """Means over the cells of the model's grid of what is known and `margin` cells from the footprint's edge, and the
    share (rows, cols) of the cells that this is. Shares of cells count, so the map's resolution does not."""
    share = np.where(known, filters.inner_share(footprint, margin), 0.0)
    weight = grid.mean(share)
    total = grid.mean(np.where(share > 0, share * np.where(known, values, 0.0), 0.0))
    return np.where(weight > TINY, total / np.maximum(weight, TINY), 0.0), weight
