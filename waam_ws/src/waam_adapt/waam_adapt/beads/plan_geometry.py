"""What the growth network sees: the geometry of the beads of a layer, and nothing of its surface or setpoints.

State and setpoints of recorded jobs follow each other, so that the effect of one cannot be told from that of the other;
the plan follows neither. All channels keep their values when the part is turned or mirrored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from .. import filters
from ..grids import CELLS_PER_BEAD, Resampler
from ..types import CorrectionInput
from . import kernels
from .bead_path import Bead, as_bytes, beads_of, nearest_of
from .model import GAP, SPREAD

NAMES = (
    'footprint', 'edge', 'inside', 'thickness', 'temperature', 'taper', 'taper wide', 'taper along', 'density',
    'density wide', 'density along', 'density along wide', 'before', 'after', 'fresh', 'fresh wide', 'fresh along',
    'turn', 'turn wide', 'turn along', 'turn across', 'density in turn', 'after in turn', 'before in turn', 'arc on',
    'arc off', 'arc on near', 'arc off near',
)  # fmt: skip
CHANNELS = len(NAMES)
# channels that the planned metal and the temperature make; the paths make the others
METAL = range(3, 8)
SUMMARIES = ('thickness', 'taper', 'density', 'turn', 'neighbours', 'arcs', 'width')
EDGE_REACH = 2.0  # bead widths from the edge at which a cell counts as interior
NEIGHBOURHOOD_WIDTHS = 1.25  # bead widths within which metal counts as of the neighbourhood
NEIGHBOUR = 0.5  # bead widths: sigma of the neighbourhood
APART = 1.5  # bead widths of travel from which on metal belongs to another pass
FRESH = 8.0  # bead widths of travel in which a pass beside fades
ROOM = 2  # cells around the footprint that the network is shown
WIDE = 3.0  # cells: sigma of the wide channels
MAX_TURN = 3.0  # right angles per bead width


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


class _Ways(NamedTuple):
    """What the paths and the outline of a layer give. maps (CHANNELS - len(METAL), rows, cols) float32: the channels
    that the planned metal is not in, in the order of NAMES; along (2, rows, cols): direction of travel, x and y."""

    maps: np.ndarray
    along: np.ndarray


WARM_STEP = 25.0  # K: growth hardly differs within one, and an answer can be prepared before a layer has cooled


def build(request: CorrectionInput, grid: Resampler) -> np.ndarray:
    """(CHANNELS, rows, cols) float32 on the grid a quarter of a bead wide; lengths in bead widths, metal relative to
    the middle of the footprint. The request must tell its paths and have a footprint."""
    width, footprint = request.bead_width, request.footprint
    covered = grid.mean(footprint.astype(float))
    inside = covered > 0.5
    height = float(np.median(request.planned[footprint]))
    planned = grid.mean(np.where(footprint, request.planned, 0.0))
    taper = np.where(inside, planned / np.maximum(covered, 1e-9) / height - 1, 0.0)
    ways = _ways_of(request, inside, grid)
    x = np.empty((CHANNELS, *grid.shape), np.float32)
    first = METAL[0]
    x[:first], x[first + len(METAL) :] = ways.maps[:first], ways.maps[first:]
    x[list(METAL)] = (
        np.full(grid.shape, 2.5 * height / width - 0.6),
        np.full(grid.shape, _warmth(request.temperature)),
        taper,
        _wide(taper, inside.astype(float)),
        _slopes(taper, 1.0, ways.along)[0],
    )
    return x


def travel(request: CorrectionInput, grid: Resampler) -> np.ndarray:
    """(2, rows, cols) direction of travel of the nearest bead, x and y, on the grid of `build`; shorter away from the
    footprint."""
    inside = grid.mean(request.footprint.astype(float)) > 0.5
    return _ways_of(request, inside, grid).along


def _ways_of(request: CorrectionInput, inside: np.ndarray, grid: Resampler) -> _Ways:
    return _ways(as_bytes(request.paths), inside.tobytes(), grid.shape, request.bead_width)


def box(x: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of an input (CHANNELS, rows, cols) that hold the footprint and half a bead around it: what the
    network is shown, in training and in use. The footprint must not be empty."""
    rows, cols = (np.flatnonzero((x[0] > 0).any(axis=i)) for i in (1, 0))
    row, col = (slice(max(i[0] - ROOM, 0), i[-1] + ROOM + 1) for i in (rows, cols))
    return row, col


@lru_cache(maxsize=4)
def _ways(paths: tuple[bytes, ...], outline: bytes, shape: tuple[int, int], width: float) -> _Ways:
    """paths: as of `bead_model`; outline: (rows, cols) bool, cells of the footprint. The newest are kept."""
    inside = np.frombuffer(outline, bool).reshape(shape)
    m = inside.astype(float)
    pieces, found = _pieces(beads_of(paths, width), width), nearest_of(paths, shape, width)
    nearest, near = found.piece, found.far / width
    density, before, after, fresh = _sums(pieces, nearest, width)
    typical = max(float(np.median(density[inside])) if inside.any() else 1.0, 1e-9)
    near = np.where(inside, 1.0, np.exp(-2 * np.maximum(near - 0.5, 0.0)))
    along = pieces.tangent.T[:, nearest] * near
    turn = pieces.turn[nearest] * near
    on, off = pieces.on[nearest] * near, pieces.off[nearest] * near
    density = np.clip(density / typical - 1, -1.0, 2.0) * m
    before, after = (np.minimum(v / typical, 3.0) for v in (before, after))
    fresh = np.clip(fresh / typical, 0.0, 3.0)
    turned = np.abs(turn)
    slopes, fine = partial(_slopes, along=along), {}
    for name, values in (
        ('density', density),
        ('fresh', fresh),
        ('turned', turned),
        ('turn', turn),
    ):
        fine[name] = slopes(values, 1.0)
    maps = (
        m, np.minimum(filters.depth(inside) / (EDGE_REACH * CELLS_PER_BEAD), 1.0), gaussian_filter(m, 8.0),
        density, _wide(density, m), fine['density'][0], slopes(density, 2.0)[0],
        before, after, fresh, _wide(fresh, m), fine['fresh'][0],
        turned, _wide(turned, m), fine['turned'][0], fine['turn'][1],
        turn * fine['density'][1], turn * slopes(after, 1.5)[1], turn * slopes(before, 1.5)[1],
        on, off, on**4, off**4,
    )  # fmt: skip
    return _Ways(np.stack(maps).astype(np.float32), along)


def _wide(values: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Mean over the neighbourhood (rows, cols); m: 1 inside of the footprint, else 0."""
    return gaussian_filter(values * m, WIDE) / np.maximum(gaussian_filter(m, WIDE), 0.05)


def _slopes(values: np.ndarray, sigma: float, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Along the travel and across it, to the left; per 2 sigma (cells)."""
    dy, dx = np.gradient(gaussian_filter(values, sigma))
    x, y = along
    return 2 * sigma * (x * dx + y * dy), 2 * sigma * (x * dy - y * dx)


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
    """0 for a cold or unknown layer, 1 at 400 degC, in steps."""
    if math.isnan(temperature):
        return 0.0
    return min(max((WARM_STEP * round(temperature / WARM_STEP) - 20) / 380, 0.0), 2.0)


def _pieces(beads: Sequence[Bead], width: float) -> _Pieces:
    """beads: in the order of laying."""
    found, begin = [], 0.0
    for bead in beads:
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
                np.clip(turn, -MAX_TURN, MAX_TURN),
                np.exp(-bead.way / width),
                np.exp((bead.way - bead.length) / width),
            )
        )
        begin += bead.length + GAP * width
    return _Pieces(*(np.concatenate(a) for a in zip(*found, strict=True)))


def _sums(pieces: _Pieces, nearest: np.ndarray, width: float) -> np.ndarray:
    """(4, rows, cols) metal per area of every cell: all; of passes beside that were laid before, after; of passes
    beside, fading with the time between. nearest (rows, cols): piece of every cell."""
    return kernels.neighbours(
        place=pieces.where[:, ::-1] * (CELLS_PER_BEAD / width),
        step=pieces.step,
        run=pieces.run / width,
        nearest=nearest,
        reach=NEIGHBOURHOOD_WIDTHS * CELLS_PER_BEAD,
        narrow=SPREAD * CELLS_PER_BEAD,
        wide=NEIGHBOUR * CELLS_PER_BEAD,
        apart=APART,
        fade=FRESH,
    )
