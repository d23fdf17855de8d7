"""What the growth network sees: the geometry of the beads of a layer, and nothing of its surface or setpoints.

State and setpoints of recorded jobs follow each other, so that the effect of one cannot be told from that of the other;
the plan follows neither. All channels keep their values when the part is turned or mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.spatial import cKDTree

from .. import filters
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import CorrectionInput
from .model import GAP, SPREAD, resampled

NAMES = (
    'footprint', 'edge', 'inside', 'thickness', 'temperature', 'taper', 'taper wide', 'taper along', 'density',
    'density wide', 'density along', 'density along wide', 'before', 'after', 'fresh', 'fresh wide', 'fresh along',
    'turn', 'turn wide', 'turn along', 'turn across', 'density in turn', 'after in turn', 'before in turn', 'arc on',
    'arc off', 'arc on near', 'arc off near',
)  # fmt: skip
CHANNELS = len(NAMES)
SUMMARIES = ('thickness', 'taper', 'density', 'turn', 'neighbours', 'arcs', 'width')
EDGE_REACH = 2.0  # bead widths from the edge at which a cell counts as interior
REACH = 1.25  # bead widths within which metal counts as of the neighbourhood
NEIGHBOUR = 0.5  # bead widths: sigma of the neighbourhood
APART = 1.5  # bead widths of travel from which on metal belongs to another pass
FRESH = 8.0  # bead widths of travel in which a pass beside fades
WIDE = 3.0  # cells: sigma of the wide channels
MOST_TURN = 3.0  # right angles per bead width


class _Pieces(NamedTuple):
    """The n pieces of all beads, a quarter of a width long. where, tangent (n, 2); step (n,): length, m; run (n,): m of
    travel in the order of laying; turn (n,): right angles per bead width, positive to the left; on, off (n,): nearness
    of arc on and off, exp(-way / width)."""

    where: np.ndarray
    tangent: np.ndarray
    step: np.ndarray
    run: np.ndarray
    turn: np.ndarray
    on: np.ndarray
    off: np.ndarray


def build(request: CorrectionInput, grid: Resampler) -> np.ndarray:
    """(CHANNELS, rows, cols) float32 on the grid a quarter of a bead wide; lengths in bead widths, metal relative to
    the middle of the footprint. The request must tell its paths and have a footprint."""
    width, footprint = request.bead_width, request.footprint
    planned = np.where(footprint, request.planned, 0.0)
    covered = grid.mean(footprint.astype(float))
    inside = covered > 0.5
    m = inside.astype(float)
    height = float(np.median(request.planned[footprint]))
    pieces = _pieces(request.paths, width)
    nearest, near, sums = _sums(pieces, grid.shape, width)
    density, before, after, fresh = sums
    typical = max(float(np.median(density[inside])) if inside.any() else 1.0, 1e-9)
    near = np.where(inside, 1.0, np.exp(-2 * np.maximum(near - 0.5, 0.0)))
    along = pieces.tangent[nearest] * near[..., None]
    turn = pieces.turn[nearest] * near
    on, off = pieces.on[nearest] * near, pieces.off[nearest] * near
    taper = np.where(inside, grid.mean(planned) / np.maximum(covered, 1e-9) / height - 1, 0.0)
    density = np.clip(density / typical - 1, -1.0, 2.0) * m
    before, after = (np.minimum(v / typical, 3.0) for v in (before, after))
    fresh = np.clip(fresh / typical, 0.0, 3.0)

    def wide(values: np.ndarray) -> np.ndarray:
        return gaussian_filter(values * m, WIDE) / np.maximum(gaussian_filter(m, WIDE), 0.05)

    def slopes(values: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
        """Along the travel and across it, to the left; per 2 sigma."""
        dy, dx = np.gradient(gaussian_filter(values, sigma))
        x, y = along[..., 0], along[..., 1]
        return 2 * sigma * (x * dx + y * dy), 2 * sigma * (x * dy - y * dx)

    turned, ones = np.abs(turn), np.ones(grid.shape)
    maps = (
        m, np.minimum(filters.depth(inside) / (EDGE_REACH * CELLS_PER_BEAD), 1.0), gaussian_filter(m, 8.0),
        (2.5 * height / width - 0.6) * ones, _warmth(request.temperature) * ones,
        taper, wide(taper), slopes(taper, 1.0)[0],
        density, wide(density), slopes(density, 1.0)[0], slopes(density, 2.0)[0],
        before, after, fresh, wide(fresh), slopes(fresh, 1.0)[0],
        turned, wide(turned), slopes(turned, 1.0)[0], slopes(turn, 1.0)[1],
        turn * slopes(density, 1.0)[1], turn * slopes(after, 1.5)[1], turn * slopes(before, 1.5)[1],
        on, off, on**4, off**4,
    )  # fmt: skip
    return np.stack(maps).astype(np.float32)


def summary(x: np.ndarray, width: float) -> np.ndarray:
    """Figures (len(SUMMARIES),) of one input (CHANNELS, rows, cols) over its footprint, to tell what is unlike the
    training. width: m."""
    channel = dict(zip(NAMES, x.astype(float), strict=True))
    inside = channel['footprint'] > 0
    if not inside.any():
        return np.full(len(SUMMARIES), np.nan)

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean(channel[name][inside] ** 2)))

    neighbours = float((channel['before'] + channel['after'])[inside].mean())
    arcs = float((channel['arc on'] + channel['arc off'])[inside].mean())
    thickness = float(channel['thickness'].mean())
    return np.array([
        thickness, rms('taper'), rms('density'), rms('turn'), neighbours, arcs, 1e3 * width
    ])  # fmt: skip


def _warmth(temperature: float) -> float:
    """0 for a cold or unknown layer, 1 at 400 degC."""
    return 0.0 if math.isnan(temperature) else min(max((temperature - 20) / 380, 0.0), 2.0)


def _pieces(paths: Sequence[np.ndarray], width: float) -> _Pieces:
    """paths: (n, 2) m, in the order of laying."""
    found, begin = [], 0.0
    for path in paths:
        bead = resampled(np.asarray(path, float), width)
        step = bead.length / len(bead.way)
        angle = np.unwrap(np.arctan2(bead.tangent[:, 1], bead.tangent[:, 0]))
        turn = np.gradient(angle) * (width / step / (0.5 * math.pi))
        turn = gaussian_filter1d(turn, 1.0, mode='nearest')
        found.append(
            _Pieces(
                bead.where,
                bead.tangent,
                np.full(len(bead.way), step),
                bead.way + begin,
                np.clip(turn, -MOST_TURN, MOST_TURN),
                np.exp(-bead.way / width),
                np.exp((bead.way - bead.length) / width),
            )
        )
        begin += bead.length + GAP * width
    return _Pieces(*(np.concatenate(a) for a in zip(*found, strict=True)))


def _sums(
    pieces: _Pieces, shape: tuple[int, int], width: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every cell: nearest piece (rows, cols), distance to it in widths (rows, cols), and (4, rows, cols) metal per
    area: all; of passes beside that were laid before, after; of passes beside, fading with the time between."""
    cell = width / CELLS_PER_BEAD
    y, x = np.meshgrid(*((np.arange(n) + 0.5) * cell for n in shape), indexing='ij')
    far, nearest = cKDTree(pieces.where).query(np.stack([x.ravel(), y.ravel()], -1))
    row, column = (pieces.where[:, i] / cell for i in (1, 0))
    down, right = _around()
    y, x = np.floor(row).astype(int)[:, None] + down, np.floor(column).astype(int)[:, None] + right
    square = (y + 0.5 - row[:, None]) ** 2 + (x + 0.5 - column[:, None]) ** 2
    good = square < (REACH * CELLS_PER_BEAD) ** 2
    good &= (y >= 0) & (x >= 0) & (y < shape[0]) & (x < shape[1])
    row = (y * shape[1] + x)[good]
    piece = np.broadcast_to(np.arange(len(column))[:, None], good.shape)[good]
    square = square[good] / CELLS_PER_BEAD**2
    later = (pieces.run[piece] - pieces.run[nearest[row]]) / width
    metal = pieces.step[piece] * np.exp(square * (-0.5 / SPREAD**2))
    beside = pieces.step[piece] * np.exp(square * (-0.5 / NEIGHBOUR**2))
    beside = np.where(np.abs(later) > APART, beside, 0.0)
    sums = [
        np.bincount(row, w, shape[0] * shape[1]).reshape(shape)
        for w in (
            metal,
            np.where(later < 0, beside, 0.0),
            np.where(later > 0, beside, 0.0),
            beside * np.exp(-np.abs(later) / FRESH),
        )
    ]
    return nearest.reshape(shape), far.reshape(shape) / width, np.stack(sums)


@lru_cache(maxsize=1)
def _around() -> tuple[np.ndarray, np.ndarray]:
    """(n,) rows and (n,) columns from the cell of a piece to all that it can reach."""
    reach = int(math.ceil(REACH * CELLS_PER_BEAD)) + 1
    side = np.arange(-reach, reach + 1)
    down, right = (a.ravel() for a in np.meshgrid(side, side, indexing='ij'))
    near = np.hypot(down, right) <= REACH * CELLS_PER_BEAD + 1
    return down[near], right[near]
