"""Beads of a shaft: lines along its axis, evenly divided over the turn, so that the last one meets the first.

A layer lies in the first turn; every bead has copies of itself a turn aside, as far as the plate shows them. Copies are
never laid: they stand for the neighbours that a bead has over the seam, in the division of the metal and in what the
correction is told.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_plan.fill import path
from waam_plan.fill.hatch import Chain
from waam_plan.fill.path import Pieces
from waam_plan.plan import PlannedLayer
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment
from waam_process.unrolled import OVERLAP, Unrolled

EDGE = 1e-3  # m: a map does not know its height nearer than half a cell to the edge of the plate


def along_axis(settings: PlanSettings) -> PlanSettings:
    """The settings with which a layer of a shaft is filled."""
    return replace(settings, strategy='zigzag', direction='y')


def chains_of(mask: np.ndarray, spec: GridSpec, settings: PlanSettings, turn: int) -> list[Chain]:
    """Chains (m, work frame) of the first turn that cover the cells `mask` (rows, cols) of a plate; turn: what
    directions alternate by.

    A layer that leaves a part of the turn free is filled from there, so that no edge lies at the seam.
    """
    shaft = settings.unrolled
    assert shaft is not None
    first = shaft.first_turn(spec)
    on = mask[:, first]
    begin = _free_column(np.asarray(on.any(axis=0)))
    x = spec.x[first][0] - spec.resolution / 2 + begin * spec.resolution
    window = GridSpec(float(x), spec.origin_y, spec.resolution, spec.rows, on.shape[1])
    rolled = np.roll(on, -begin, axis=1)
    if not rolled.any():
        return []
    chains, _ = path.hatch_region(rolled, window, along_axis(settings), turn)
    return [part for chain in chains for part in _folded(chain, shaft)]


def _free_column(used: np.ndarray) -> int:
    """The column in the middle of the widest stretch of the turn without metal; 0 where there is none. used: (n,)."""
    if used.all() or not used.any():
        return 0
    after = int(np.argmax(used))  # a stretch that goes over the seam is one stretch
    turned = np.roll(used, -after)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], turned, [True]]).astype(int)))
    begins, ends = edges[::2], edges[1::2]
    widest = int(np.argmax(ends - begins))
    return int((begins[widest] + ends[widest]) // 2 + after) % len(used)


def _folded(chain: Chain, shaft: Unrolled) -> list[Chain]:
    """The chain in the first turn; two where it crosses the seam."""
    out: list[Chain] = []
    before: int | None = None
    for line in chain:
        turns = int(np.floor((line[:, 0].mean() - OVERLAP) / shaft.period))
        if turns != before:
            out.append([])
        out[-1].append(line - (turns * shaft.period, 0.0))
        before = turns
    return out


def with_copies(chains: list[Chain], shaft: Unrolled) -> list[Chain]:
    """The chains, and behind them copies of their lines that lie on the plate."""
    out = list(chains)
    for step in (-shaft.period, shaft.period):
        for chain in chains:
            part: Chain = []
            for line in (own + (step, 0.0) for own in chain):
                on = line[:, 0].min() >= EDGE and line[:, 0].max() <= shaft.length_x - EDGE
                if on:
                    part.append(line)
                elif part:  # the chain leaves the plate here
                    out.append(part)
                    part = []
            if part:
                out.append(part)
    return out


def own(pieces: Pieces, height: np.ndarray, chains: int) -> tuple[Pieces, np.ndarray]:
    """Those of the first `chains` chains: without the copies."""
    on = pieces.chain < chains
    return Pieces(pieces.start[on], pieces.end[on], pieces.bead[on], pieces.chain[on]), height[on]


def on_shaft(segments: list[Segment], shaft: Unrolled) -> list[Segment]:
    """Deposits with the width that their beads have on the shaft: `share` of that on the plate, at half of their
    height, which is the metal between two radii over that of a plate of the same thickness."""
    return [
        s.at(width=s.width * float(shaft.share(s.midpoint[2] + s.height / 2)))
        if s.kind == Kind.DEPOSIT
        else s
        for s in segments
    ]


def arc_paths(layer: PlannedLayer, settings: PlanSettings) -> tuple[np.ndarray, ...]:
    """Stretches with the arc on, (n, 2) m, as the correction knows a layer: of a shaft with their copies."""
    paths = list(layer.arc_paths)
    shaft = settings.unrolled
    if shaft is None:
        return tuple(paths)
    for step in (-shaft.period, shaft.period):
        for own_path in layer.arc_paths:
            copy = own_path + (step, 0.0)
            on = (copy[:, 0] >= 0.0) & (copy[:, 0] <= shaft.length_x)
            stretches = np.split(np.arange(len(copy)), np.flatnonzero(np.diff(on)) + 1)
            paths += [copy[part] for part in stretches if on[part[0]] and len(part) > 1]
    return tuple(paths)


def segments_with_copies(segments: list[Segment], settings: PlanSettings) -> list[Segment]:
    """Deposits as `arc_paths`; of a plane part the segments as they are."""
    shaft = settings.unrolled
    if shaft is None:
        return segments
    out = list(segments)
    for step in (-shaft.period, shaft.period):
        for s in segments:
            if s.kind == Kind.DEPOSIT and 0.0 < s.midpoint[0] + step < shaft.length_x:
                (xa, *a), (xb, *b) = s.start, s.end
                out.append(s.at(start=(xa + step, *a), end=(xb + step, *b)))
    return out
