"""Paths of the beads of a shaft that turns.

A zone that goes all round is one helix without a start in between: a full turn at its one end, and after every turn a
step along the axis, up to a full turn at its other end. Its x runs on from turn to turn. (A helix of constant slope
leaves a wedge at both ends, where two turns lie on one another all around; closed rings have a start each.) A zone that
leaves a part of the turn free is hatched along its longer side, from the middle of what is free, so that no edge lies
at the seam.
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

GOLDEN = 0.381966  # of a turn between the starts of neighbouring layers, so that any number of them is spread
EDGE_INSET = 0.28  # bead widths between the first turn and the end of the zone
EDGE_METAL = 1.0  # of beads along the edge over what the division gives them
SMOOTH = 1.5e-3  # m of the turn over which the end of a zone is smoothed
STEP = 0.5e-3  # m of x between points of a helix
STEP_OVER = 2.5  # pitches of the way around, in which a helix goes on by a pitch along the axis
MOST_OVER = 0.25  # turns, of the same


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
    return replace(
        settings,
        ring_inset=settings.ring_inset or EDGE_INSET,
        edge_metal=settings.edge_metal or EDGE_METAL,
    )


def chains_of(mask: np.ndarray, spec: GridSpec, settings: PlanSettings, turn: int) -> list[Chain]:
    """Chains (m, work frame, x running on beyond the first turn) that cover the cells `mask` (rows, cols) of a plate.

    settings: of `filling`; strategy zigzag or direction y: lines along the axis everywhere. turn: what the place of the
    start and the direction along the axis alternate by.
    """
    shaft = settings.unrolled
    assert shaft is not None
    first = shaft.first_turn(spec)
    on = mask[:, first]
    edge = float(spec.x[first][0]) - spec.resolution / 2
    window = GridSpec(edge, spec.origin_y, spec.resolution, spec.rows, on.shape[1])
    lines = settings.strategy == 'zigzag' or settings.direction == 'y'
    chains: list[Chain] = []
    for island in islands_around(on):
        ends = None if lines else ends_of(island, window)
        if ends is None:
            chains += _hatched(
                island, window, replace(settings, direction='y') if lines else settings, turn
            )
        else:
            chains += _Helix(ends, window, settings, shaft).chains(turn)
    return chains


def direction_of(chains: list[Chain]) -> str:
    """'x' or 'y': what most of the way of some chains runs along."""
    steps = [np.abs(np.diff(line, axis=0)).sum(axis=0) for chain in chains for line in chain]
    along = np.sum(steps, axis=0) if steps else np.zeros(2)
    return 'x' if along[0] >= along[1] else 'y'


def goes_round(chain: Chain, shaft: Unrolled) -> bool:
    """Whether a chain is a helix, or a part of one."""
    return bool(chain[-1][-1, 0] - chain[0][0, 0] > 0.99 * shaft.period)


def islands_around(on: np.ndarray) -> list[np.ndarray]:
    """Masks (rows, n) of the connected parts of one turn; the last column is beside the first one."""
    labels, count = ndimage.label(on, EIGHT)
    same = list(range(count + 1))

    def root(k: int) -> int:
        while same[k] != k:
            k = same[k]
        return k

    n = len(on)
    for row in np.flatnonzero(on[:, -1]).tolist():
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


@dataclass(frozen=True)
class _Helix:
    """Between both ends of a zone that goes all round."""

    ends: Ends
    window: GridSpec
    settings: PlanSettings
    shaft: Unrolled

    def chains(self, turn: int) -> list[Chain]:
        """One chain, or several where the axis of the machine is not long enough for all turns."""
        s, shaft = self.settings, self.shaft
        room = self.ends.width - 2 * self.inset
        count = max(1, math.ceil(room / s.pitch - 0.1)) if room > 0.4 * s.pitch else 0
        begin = OVERLAP + shaft.period * ((turn * GOLDEN) % 1.0)
        knots, levels = steps(count, min(STEP_OVER * s.pitch / shaft.period, MOST_OVER))
        if turn % 2 == 0:
            levels = 1.0 - levels
        most = max(1, int((s.machine_max[0] - OVERLAP) / shaft.period) - 1)
        return self._cut(knots, levels, begin, most)

    @property
    def inset(self) -> float:
        """m of the first turn from the end of the zone."""
        return self.settings.ring_inset * self.settings.bead_width

    def _cut(self, knots: np.ndarray, levels: np.ndarray, begin: float, most: int) -> list[Chain]:
        """Chains of at most `most` turns, one line per turn, from x = `begin`. knots, levels: of `steps`."""
        chains: list[Chain] = []
        at, x = 0.0, begin
        while at < knots[-1] - 1e-9:
            chain: Chain = []
            until = min(at + most, float(knots[-1]))
            while at < until - 1e-9:
                to = min(at + 1.0, until)
                turns = np.unique(np.concatenate([[at, to], knots[(knots > at) & (knots < to)]]))
                chain.append(self._line(x, turns - at, np.interp(turns, knots, levels)))
                x += (to - at) * self.shaft.period
                at = to
            chains.append(chain)
            x = float(self.shaft.folded(x))
        return chains

    def _line(self, x: float, turns: np.ndarray, level: np.ndarray) -> np.ndarray:
        """(n, 2) m: from x on, at `level` (m,) of the way along the axis after `turns` (m,)."""
        count = max(2, math.ceil(turns[-1] * self.shaft.period / STEP) + 1)
        t = np.union1d(np.linspace(0.0, turns[-1], count), turns)
        at = x + t * self.shaft.period
        column = (self.shaft.folded(at) - self.window.x[0]) / self.window.resolution
        cells = np.arange(len(self.ends.low))
        low, high = (
            np.interp(column, cells, e, period=len(cells)) for e in (self.ends.low, self.ends.high)
        )
        inner = np.minimum(self.inset, (high - low) / 2)
        return np.column_stack(
            [at, low + inner + np.interp(t, turns, level) * (high - low - 2 * inner)]
        )


def steps(count: int, over: float) -> tuple[np.ndarray, np.ndarray]:
    """Of a helix with `count` steps along the axis, each over `over` turns: knots (n,) in turns, and levels (n,) there,
    the share of the way along the axis. It stays a full turn at both ends, and a turn from step to step."""
    if not count:
        return np.array([0.0, 1.0]), np.array([0.5, 0.5])
    between = [over, 1.0 - over] * count
    knots = np.cumsum([0.0, 1.0, *between[:-1], 1.0])
    return knots, np.repeat(np.arange(count + 1) / count, 2)


def _hatched(
    island: np.ndarray, window: GridSpec, settings: PlanSettings, turn: int
) -> list[Chain]:
    """Lines to and fro, from the middle of what an island leaves free of the turn; direction as the settings say, auto
    along the longer side."""
    begin = free_column(np.asarray(island.any(axis=0)))
    x = window.origin_x + begin * window.resolution
    turned = GridSpec(x, window.origin_y, window.resolution, window.rows, window.cols)
    cells = np.roll(island, -begin, axis=1)
    return path.hatch_region(cells, turned, replace(settings, strategy='zigzag'), turn)[0]


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
