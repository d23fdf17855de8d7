"""Beads of a shaft on its plate.

The x of a bead runs on over the seam, as far as it goes around. What is divided, sampled or told lies in the first
turn, with copies a turn aside as far as the plate shows them. Copies are never laid: they stand for the neighbours that
a bead has over the seam, in the division of the metal and in what the correction is told.
"""

from __future__ import annotations

import math

import numpy as np

from waam_plan.fill.hatch import Chain
from waam_plan.fill.linking import spread_starts
from waam_plan.fill.path import Pieces
from waam_plan.plan import PlannedLayer
from waam_plan.settings import PlanSettings
from waam_plan.shaft.around import goes_round
from waam_process.grid import HeightGrid
from waam_process.segment import Kind, Segment
from waam_process.unrolled import OVERLAP, Unrolled

EDGE = 1e-3  # m: a map does not know its height nearer than half a cell to the edge of the plate


def spread(chains: list[Chain], starts: np.ndarray, settings: PlanSettings) -> list[Chain]:
    """`linking.spread_starts`; a helix begins where it does, for it runs on around the shaft. starts: (n, 2) m."""
    shaft = settings.unrolled
    if shaft is None:
        return spread_starts(chains, starts, settings.start_spread)
    again = np.concatenate(
        [home_points(starts, settings) + (k * shaft.period, 0.0) for k in (0, 1)]
    )
    return [
        chain
        if goes_round(chain, shaft)
        else spread_starts([chain], again, settings.start_spread)[0]
        for chain in chains
    ]


def shown(pieces: Pieces, shaft: Unrolled) -> Pieces:
    """The pieces in the first turn, in the same order, and behind them copies of them that lie on the plate."""
    middle = (pieces.start[:, 0] + pieces.end[:, 0]) / 2
    home = shaft.folded(middle) - middle
    parts = [_moved(pieces, home)]
    for step in (-shaft.period, shaft.period):
        low, high = (
            f(pieces.start[:, 0], pieces.end[:, 0]) + home + step for f in (np.minimum, np.maximum)
        )
        on = np.flatnonzero((low >= EDGE) & (high <= shaft.length_x - EDGE))
        copy = _moved(pieces, home + step)
        first = np.diff(on, prepend=-2) > 1  # where the copies of a chain come onto the plate
        first[1:] |= np.diff(pieces.chain[on]) != 0
        chain = np.cumsum(first) + parts[-1].chain.max(initial=0)
        parts.append(Pieces(copy.start[on], copy.end[on], copy.bead[on], chain))
    return Pieces(
        *(
            np.concatenate([getattr(p, name) for p in parts])
            for name in ('start', 'end', 'bead', 'chain')
        )
    )


def _moved(pieces: Pieces, step: np.ndarray) -> Pieces:
    """step: (n,) m along x."""
    aside = np.column_stack([step, np.zeros((len(step), 2))])
    return Pieces(pieces.start + aside, pieces.end + aside, pieces.bead, pieces.chain)


def first_of(pieces: Pieces, count: int) -> Pieces:
    """The first `count` pieces: without the copies."""
    return Pieces(
        pieces.start[:count], pieces.end[:count], pieces.bead[:count], pieces.chain[:count]
    )


def on_shaft(segments: list[Segment], shaft: Unrolled) -> list[Segment]:
    """Deposits with the width that their beads have on the shaft: `share` of that on the plate, at half of their
    height, which is the metal between two radii over that of a plate of the same thickness."""
    middle = np.array([s.midpoint[2] + s.height / 2 for s in segments])
    shares = shaft.share(middle).tolist()
    return [
        s.at(width=s.width * share) if s.kind == Kind.DEPOSIT else s
        for s, share in zip(segments, shares, strict=True)
    ]


def arc_paths(layer: PlannedLayer, settings: PlanSettings) -> tuple[np.ndarray, ...]:
    """Stretches with the arc on, (n, 2) m, as the correction knows a layer: of a shaft as the plate shows them, every
    turn of a helix and all their copies."""
    shaft = settings.unrolled
    if shaft is None:
        return tuple(layer.arc_paths)
    paths: list[np.ndarray] = []
    for own in layer.arc_paths:
        first = math.ceil((own[:, 0].min() - shaft.length_x) / shaft.period)
        last = math.floor(own[:, 0].max() / shaft.period)
        for turns in range(first, last + 1):
            copy = own - (turns * shaft.period, 0.0)
            on = (copy[:, 0] >= 0.0) & (copy[:, 0] <= shaft.length_x)
            stretches = np.split(np.arange(len(copy)), np.flatnonzero(np.diff(on)) + 1)
            paths += [copy[part] for part in stretches if on[part[0]] and len(part) > 1]
    return tuple(paths)


def home(segments: list[Segment], settings: PlanSettings) -> list[Segment]:
    """The segments with their places in the first turn, each moved as a whole; of a plane part as they are."""
    shaft = settings.unrolled
    if shaft is None:
        return segments
    out = []
    for s in segments:
        step = float(shaft.folded(s.midpoint[0])) - s.midpoint[0]
        out.append(_along(s, step) if abs(step) > 1e-9 else s)
    return out


def drawn(segments: list[Segment], settings: PlanSettings) -> list[Segment]:
    """The segments for a picture: of a shaft in the first turn, without its turns back."""
    shaft = settings.unrolled
    here = home(segments, settings)
    return here if shaft is None else [s for s in here if s.length < shaft.period / 2]


def in_their_places(changed: list[Segment], segments: list[Segment]) -> list[Segment]:
    """The segments `changed`, which `home` had moved, where they were."""
    return [
        c if c.start[0] == s.start[0] else c.at(start=s.start, end=s.end)
        for c, s in zip(changed, segments, strict=True)
    ]


def _along(s: Segment, step: float) -> Segment:
    (xa, *a), (xb, *b) = s.start, s.end
    return s.at(start=(xa + step, *a), end=(xb + step, *b))


def inside_turn(surface: HeightGrid, settings: PlanSettings) -> HeightGrid:
    """The surface without what the plate shows twice, and what beads beside that reach; of a plane part as it is."""
    shaft = settings.unrolled
    if shaft is None:
        return surface
    x, near = surface.spec.x, settings.bead_width
    inside = (x >= OVERLAP + near) & (x < OVERLAP + shaft.period - near)
    return surface.with_z(np.where(inside, surface.z, np.nan))


def home_points(points: np.ndarray, settings: PlanSettings) -> np.ndarray:
    """(n, 2 or more) m in the first turn; of a plane part as they are."""
    shaft = settings.unrolled
    if shaft is None:
        return points
    return np.column_stack([shaft.folded(points[:, 0]), points[:, 1:]])


def segments_with_copies(segments: list[Segment], settings: PlanSettings) -> list[Segment]:
    """Deposits as `arc_paths`; of a plane part the segments as they are."""
    shaft = settings.unrolled
    if shaft is None:
        return segments
    here = home(segments, settings)
    out = list(here)
    for step in (-shaft.period, shaft.period):
        for s in here:
            if s.kind == Kind.DEPOSIT and 0.0 < s.midpoint[0] + step < shaft.length_x:
                out.append(_along(s, step))
    return out
