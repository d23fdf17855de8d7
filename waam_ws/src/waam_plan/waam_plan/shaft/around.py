"""Beads around a shaft: the shaft turns under the torch, which moves slowly along the axis.

A zone that goes all round is one helix without a start in between: a full turn at its lower end, the helix, a full turn
at its upper end. Its x runs on from turn to turn. Or it is rings, each closed in itself, starts spread over the turn. A
zone that leaves a part of the turn free is laid in arcs to and fro, filled from the middle of what is free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from waam_plan.fill import path
from waam_plan.fill.hatch import Chain
from waam_plan.masks import EIGHT
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.unrolled import OVERLAP, Unrolled

GOLDEN = 0.381966  # share of a turn between starts, so that any number of them is spread
EDGE_INSET = 0.28  # bead widths between the first turn and the end of the zone
EDGE_METAL = 1.0  # of the turns along the ends of the zone over what the division gives them
SMOOTH = 1.5e-3  # m of the turn over which the end of a zone is smoothed
STEP = 0.5e-3  # m of x between points of a bead
STEP_OVER = 2.5  # pitches of way around, in which a helix goes on by a pitch along the axis
RINGS = ('contour',)  # strategies that lay closed rings


@dataclass(frozen=True)
class Ends:
    """Where a zone that goes all round begins and ends along the axis, by the columns of the first turn: (n,) m."""

    low: np.ndarray
    high: np.ndarray

    @property
    def width(self) -> float:
        """Mean along the axis, m."""
        return float((self.high - self.low).mean())


def filling(settings: PlanSettings) -> PlanSettings:
    """The settings with which a layer of a shaft is filled."""
    inset = settings.ring_inset or EDGE_INSET
    return replace(
        settings, direction='x', ring_inset=inset, edge_metal=settings.edge_metal or EDGE_METAL
    )


def chains_of(mask: np.ndarray, spec: GridSpec, settings: PlanSettings, turn: int) -> list[Chain]:
    """Chains (m, work frame; x of helices and rings runs on beyond the first turn) that cover the cells `mask` (rows,
    cols) of a plate; turn: what the place of the start and the direction along the axis alternate by."""
    shaft = settings.unrolled
    assert shaft is not None
    first = shaft.first_turn(spec)
    on = mask[:, first]
    window = GridSpec(float(spec.x[first][0]) - spec.resolution / 2, spec.origin_y, spec.resolution,
                      spec.rows, on.shape[1])  # fmt: skip
    chains: list[Chain] = []
    for island in islands_around(on):
        if (ends := ends_of(island, window)) is not None:
            chains += _all_round(ends, window, settings, shaft, turn)
        else:
            chains += _arcs(island, window, settings, shaft, turn)
    return chains


def islands_around(on: np.ndarray) -> list[np.ndarray]:
    """Masks (rows, n) of the connected parts of one turn; the last column is beside the first one."""
    labels, count = ndimage.label(on, EIGHT)
    same = list(range(count + 1))

    def root(k: int) -> int:
        while same[k] != k:
            k = same[k]
        return k

    n = len(on)
    for row in np.flatnonzero(on[:, -1]):
        for beside in range(max(row - 1, 0), min(row + 2, n)):
            if on[beside, 0]:
                same[root(int(labels[row, -1]))] = root(int(labels[beside, 0]))
    of = np.array([root(k) for k in range(count + 1)])[labels]
    return [of == k for k in sorted({root(k) for k in range(1, count + 1)})]


def ends_of(island: np.ndarray, window: GridSpec) -> Ends | None:
    """Ends of an island (rows, n) of one turn that goes all round without holes and gaps; None for others."""
    filled = ndimage.binary_fill_holes(np.tile(island, 3))[:, island.shape[1] : 2 * island.shape[1]]
    if not filled.any(axis=0).all():
        return None
    rows = len(filled)
    low, high = filled.argmax(axis=0), rows - filled[::-1].argmax(axis=0)
    if ((high - low) != filled.sum(axis=0)).any():
        return None
    sigma = SMOOTH / window.resolution
    edges = (
        window.origin_y + window.resolution * ndimage.gaussian_filter1d(e.astype(float), sigma, mode='wrap')
        for e in (low, high)
    )  # fmt: skip
    return Ends(*edges)


def _all_round(
    ends: Ends, window: GridSpec, settings: PlanSettings, shaft: Unrolled, turn: int
) -> list[Chain]:
    """Helix or rings between both ends of a zone."""
    inset = settings.ring_inset * settings.bead_width
    room = ends.width - 2 * inset
    count = max(1, math.ceil(room / settings.pitch - 0.1)) if room > 0.4 * settings.pitch else 0
    begin = OVERLAP + shaft.period * ((turn * GOLDEN) % 1.0)
    if settings.strategy in RINGS:
        shares = [np.full(2, k / count if count else 0.5) for k in range(count + 1)]
        if turn % 2 == 0:
            shares.reverse()
        starts = [OVERLAP + (begin - OVERLAP + k * GOLDEN * shaft.period) % shaft.period for k in range(count + 1)]  # fmt: skip
        return [
            [_line(ends, window, inset, shaft, x, np.array([0.0, 1.0]), share)]
            for x, share in zip(starts, shares, strict=True)
        ]
    if not count:
        return [[_line(ends, window, inset, shaft, begin, np.array([0.0, 1.0]), np.full(2, 0.5))]]
    over = min(STEP_OVER * settings.pitch / shaft.period, 0.25)
    between = [over, 1.0 - over] * count
    knots = np.cumsum([0.0, 1.0, *between[:-1], 1.0])
    levels = np.repeat(np.arange(count + 1) / count, 2)
    if turn % 2 == 0:
        levels = 1.0 - levels
    most = max(1, int((settings.machine_max[0] - begin) / shaft.period))
    return _cut(knots, levels, ends, window, inset, shaft, begin, most)


def _cut(
    knots: np.ndarray,
    levels: np.ndarray,
    ends: Ends,
    window: GridSpec,
    inset: float,
    shaft: Unrolled,
    begin: float,
    most: int,
) -> list[Chain]:
    """A helix in chains of at most `most` turns, which the axis of the machine can make in one go; one line per turn.
    knots: (n,) turns, levels: (n,) share of the way along the axis there."""
    chains: list[Chain] = []
    at, x = 0.0, begin
    while at < knots[-1] - 1e-9:
        chain: Chain = []
        until = min(at + most, float(knots[-1]))
        while at < until - 1e-9:
            to = min(at + 1.0, until)
            turns = np.unique(np.concatenate([[at, to], knots[(knots > at) & (knots < to)]]))
            chain.append(_line(ends, window, inset, shaft, x, turns - at, np.interp(turns, knots, levels)))  # fmt: skip
            x += (to - at) * shaft.period
            at = to
        chains.append(chain)
        x = float(shaft.folded(x))
    return chains


def _line(
    ends: Ends,
    window: GridSpec,
    inset: float,
    shaft: Unrolled,
    x: float,
    turns: np.ndarray,
    share: np.ndarray,
) -> np.ndarray:
    """(n, 2) m: from x on, at `share` (m,) of the way along the axis after `turns` (m,)."""
    count = max(2, math.ceil(turns[-1] * shaft.period / STEP) + 1)
    t = np.union1d(np.linspace(0.0, turns[-1], count), turns)
    at = x + t * shaft.period
    column = (shaft.folded(at) - window.x[0]) / window.resolution
    cells = np.arange(len(ends.low))
    low, high = (np.interp(column, cells, e, period=len(cells)) for e in (ends.low, ends.high))
    inner = np.minimum(inset, (high - low) / 2)
    v = np.interp(t, turns, share)
    return np.column_stack([at, low + inner + v * (high - low - 2 * inner)])


def _arcs(
    island: np.ndarray, window: GridSpec, settings: PlanSettings, shaft: Unrolled, turn: int
) -> list[Chain]:
    """Lines around the shaft, to and fro, of an island that leaves a part of the turn free; its x may run on beyond the
    first turn."""
    begin = free_column(np.asarray(island.any(axis=0)))
    rolled = np.roll(island, -begin, axis=1)
    x = window.origin_x + begin * window.resolution
    turned = GridSpec(x, window.origin_y, window.resolution, window.rows, window.cols)
    chains, _ = path.hatch_region(rolled, turned, replace(settings, strategy='zigzag'), turn)
    return chains


def free_column(used: np.ndarray) -> int:
    """The column in the middle of the widest stretch of the turn without metal; 0 where there is none. used: (n,)."""
    if used.all() or not used.any():
        return 0
    after = int(np.argmax(used))  # a stretch that goes over the seam is one stretch
    turned = np.roll(used, -after)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], turned, [True]]).astype(int)))
    begins, ends = edges[::2], edges[1::2]
    widest = int(np.argmax(ends - begins))
    return int((begins[widest] + ends[widest]) // 2 + after) % len(used)
