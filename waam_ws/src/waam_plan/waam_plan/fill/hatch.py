"""Zig-zag hatch of a region given as a mask: bands of one pitch, one bead in the middle of each.

Everything here is in cells: point (u, v) lies at column u, row v, the centre of cell (r, c) is (c + 0.5, r + 0.5).
Beads run along the columns (u). Bands tile the region without gaps, so every cell belongs to one band and lies
within about half a pitch of its bead; where a band is cut by a slanting edge, its bead keeps to the middle of
what is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from waam_plan.masks import EIGHT, islands

# pitches: across an arm at least this wide each band gets a stub, linked along the arm
NARROWEST = 0.4

Chain = list[np.ndarray]  # beads (n, 2) welded one after the other without putting the arc out


@dataclass(frozen=True)
class Run:
    """One bead: band number within its island and polyline (n, 2), u rising."""

    band: int
    line: np.ndarray


def hatch(
    mask: np.ndarray,
    pitch: float,
    inset: float,
    min_share: float,
    stagger: bool = False,
    second: bool = False,
) -> list[Chain]:
    """Chains of beads that cover the mask.

    pitch: widest distance of beads (it shrinks to divide the width evenly); inset: distance between the ends of
    a bead and the edge; min_share: a bead ends where less than this share of its band lies in the region;
    stagger: one band more; beads lie over the valleys of the unstaggered pattern (two bands at each edge are
    narrower). second: begin at the last band and place the turns where the other pattern has none, so that
    two layers together leave no gap between bead ends.
    """
    chains: list[Chain] = []
    for island in islands(mask):
        runs = _runs(island, pitch, inset, min_share, stagger)
        if second:
            bands = 1 + max(r.band for r in runs)
            runs = [Run(r.band, r.line[::-1] if bands % 2 == 0 else r.line) for r in runs[::-1]]
        chains.extend(_chains(runs, island, 2 * pitch))
    return chains


def band_edges(first: float, last: float, pitch: float, stagger: bool) -> np.ndarray:
    """Edges of the bands between two rows, one more than there are bands."""
    width = last - first
    n = max(1, int(np.ceil(width / pitch - 0.1)))
    p = width / n
    if not stagger or n < 2:
        return first + p * np.arange(n + 1)
    inner = first + p * (1.5 + np.arange(n - 2))
    return np.concatenate([[first, first + 0.75 * p], inner, [last - 0.75 * p, last]])


def _runs(
    island: np.ndarray, pitch: float, inset: float, min_share: float, stagger: bool
) -> list[Run]:
    rows = np.flatnonzero(island.any(axis=1))
    edges = band_edges(rows[0], rows[-1] + 1, pitch, stagger)
    runs: list[Run] = []
    for band, (low, high) in enumerate(zip(edges, edges[1:], strict=False)):
        a, b = int(np.ceil(low - 0.5)), int(np.ceil(high - 0.5))
        runs.extend(Run(band, line) for line in _band(island, a, b, pitch, inset, min_share))
    return runs or [_smallest_bead(island)]


def _band(
    island: np.ndarray, a: int, b: int, pitch: float, inset: float, min_share: float
) -> list[np.ndarray]:
    """Beads of rows a..b-1, left to right."""
    labels, count = ndimage.label(island[a:b], EIGHT)
    lines = []
    for i, (_, cols) in enumerate(ndimage.find_objects(labels)):
        part = labels[:, cols] == i + 1
        middle, filled = _middle(part, pitch)
        for c0, c1 in _stretches(filled >= min_share):
            line = _line(c0, c1, inset, pitch)
            if line is not None:
                v = np.interp(line, np.arange(len(middle)) + 0.5, middle)
                v = _into(part, line, v)
                lines.append(np.column_stack([line + cols.start, v + a]))
    return sorted(lines, key=lambda p: p[0, 0]) if count else []


def _middle(part: np.ndarray, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    """Middle row of the part in each column, smoothed over half a pitch, and the share of rows that it fills."""
    n = part.sum(axis=0)
    centre = (part * (np.arange(part.shape[0]) + 0.5)[:, None]).sum(axis=0) / np.maximum(n, 1)
    centre[n == part.shape[0]] = part.shape[0] / 2
    known = np.flatnonzero(n)
    centre = np.interp(np.arange(len(n)), known, centre[known])
    return ndimage.uniform_filter1d(centre, max(1, int(pitch / 2)), mode='nearest'), n / part.shape[
        0
    ]


def _stretches(on: np.ndarray) -> list[tuple[int, int]]:
    """First and one-past-last column of each stretch; gaps of up to two columns are bridged."""
    on = ndimage.binary_closing(np.pad(on, 3), np.ones(3))[3:-3] | on
    edge = np.flatnonzero(np.diff(np.pad(on.astype(np.int8), 1)))
    return list(zip(edge[::2], edge[1::2], strict=True))


def _line(c0: int, c1: int, inset: float, pitch: float) -> np.ndarray | None:
    """Stations u of a bead between two edges, at most one cell apart; None when there is no room for a bead."""
    length = c1 - c0 - 2 * inset
    if length < pitch / 2:
        if c1 - c0 < NARROWEST * pitch:
            return None
        length = min(pitch, c1 - c0) / 2
    centre = (c0 + c1) / 2
    return np.linspace(centre - length / 2, centre + length / 2, int(np.ceil(length)) + 1)


def _into(part: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Rows v moved to the nearest cell of the part where they lie off it."""
    col = np.clip(u.astype(int), 0, part.shape[1] - 1)
    row = np.clip(v.astype(int), 0, part.shape[0] - 1)
    out = v.copy()
    for i in np.flatnonzero(~part[row, col] & np.any(part, axis=0)[col]):
        rows = np.flatnonzero(part[:, col[i]])
        out[i] = rows[np.argmin(np.abs(rows + 0.5 - v[i]))] + 0.5
    return out


def _smallest_bead(island: np.ndarray) -> Run:
    """For an island with no room for a regular bead: one along its longer axis through its middle."""
    row, col = np.nonzero(island)
    centre = np.array([col.mean() + 0.5, row.mean() + 0.5])
    points = np.column_stack([col + 0.5, row + 0.5]) - centre
    axis = np.linalg.eigh(points.T @ points)[1][:, 1]
    axis = axis if axis[0] >= 0 else -axis
    along = points @ axis
    half = max(1.0, 0.35 * float(np.ptp(along)))
    return Run(0, centre + np.linspace(-half, half, int(np.ceil(2 * half)) + 1)[:, None] * axis)


def _chains(runs: list[Run], island: np.ndarray, reach: float) -> list[Chain]:
    """Runs in the order of welding, each in the direction of welding; few arc starts, short moves."""
    left = list(runs)
    run = left.pop(0)
    chains: list[Chain] = [[run.line]]
    while left:
        here = chains[-1][-1][-1]
        ends = np.array([[r.line[0], r.line[-1]] for r in left])
        away = np.linalg.norm(ends - here, axis=2)
        near = np.abs(np.array([r.band for r in left]) - run.band) <= 1
        linkable = np.where(near[:, None] & (away <= reach), away, np.inf)
        pick = _first_link(here, ends, linkable, island)
        starts_chain = pick is None
        if pick is None:
            row, end = np.unravel_index(np.argmin(away), away.shape)
            pick = int(row), int(end)
        run = left.pop(int(pick[0]))
        line = run.line if pick[1] == 0 else run.line[::-1]
        if starts_chain:
            chains.append([line])
        else:
            chains[-1].append(line)
    return chains


def _first_link(
    here: np.ndarray, ends: np.ndarray, away: np.ndarray, island: np.ndarray
) -> tuple[int, int] | None:
    """The nearest end that can be reached with the arc on without leaving the island."""
    for flat in np.argsort(away, axis=None):
        i, side = np.unravel_index(flat, away.shape)
        if not np.isfinite(away[i, side]):
            return None
        if _inside(here, ends[i, side], island):
            return int(i), int(side)
    return None


def _inside(a: np.ndarray, b: np.ndarray, island: np.ndarray) -> bool:
    t = np.linspace(0, 1, 2 + int(2 * np.linalg.norm(b - a)))[:, None]
    u, v = (a + t * (b - a)).T
    row = np.clip(v.astype(int), 0, island.shape[0] - 1)
    col = np.clip(u.astype(int), 0, island.shape[1] - 1)
    return bool(island[row, col].all())
