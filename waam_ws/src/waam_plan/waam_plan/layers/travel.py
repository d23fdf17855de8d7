"""From pieces to a layer's segments: speeds, idle moves over the metal as built, dwells, leads of the arc."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from waam_plan.fill.path import Pieces
from waam_plan.plan import base_feed, hop, leg
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Point, Segment
from waam_process.unrolled import Unrolled

FEED_FLOOR = 0.42  # of the nominal deposition rate; below it the torch goes faster

Run = list[Segment]  # welded without putting the arc out


@dataclass(frozen=True)
class Ceiling:
    """Highest metal (rows, cols) m around every cell, as far as the torch is wide."""

    spec: GridSpec
    z: np.ndarray
    shaft: Unrolled | None = None  # of a turning shaft, whose places come round again

    @classmethod
    def over(
        cls, spec: GridSpec, metal: np.ndarray, radius: float, shaft: Unrolled | None = None
    ) -> Ceiling:
        """metal: (rows, cols) m as it stands when the layer is done, NaN = nothing known there."""
        z = np.where(np.isfinite(metal), metal, -np.inf)
        size = 2 * math.ceil(radius / spec.resolution) + 1
        return cls(spec, ndimage.maximum_filter(z, size=size, mode='nearest'), shaft)

    def above(self, a: Point, b: Point) -> float:
        """Highest metal (m) below the straight way from a to b; -inf outside the grid."""
        n = 2 + int(2 * math.dist(a[:2], b[:2]) / self.spec.resolution)
        x, y = (np.linspace(a[i], b[i], n) for i in (0, 1))
        row, col = self.spec.cell(self.shaft.folded(x) if self.shaft else x, y)
        rows, cols = self.spec.shape
        on = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        return float(self.z[row[on], col[on]].max(initial=-math.inf))


def to_segments(
    pieces: Pieces,
    height: np.ndarray,
    layer: int,
    ceiling: Ceiling,
    safe_z: float,
    settings: PlanSettings,
    slower: float = 1.0,
) -> list[Segment]:
    """Segments of one layer from safe height to safe height, indices from 0.

    height: (n,) m, metal of the pieces. slower: factor of the travel speed; the feed follows it by eq 2.17.
    """
    speed = slower * programmed_speed(height, settings)
    runs = _runs(pieces, height, speed, layer, settings)
    return connected(runs, layer, ceiling, safe_z, settings)


def programmed_speed(height: np.ndarray, settings: PlanSettings) -> np.ndarray:
    """Travel speed (n,) m/s: nominal, faster where the deposition rate would fall below the floor."""
    share = height / settings.layer_height
    faster = np.maximum(1.0, FEED_FLOOR / np.maximum(share, 1e-6))
    return np.minimum(settings.speed * faster, settings.speed_max)


def thinnest_bead(settings: PlanSettings) -> float:
    """Height (m) of a bead with the least feed at the highest programmed speed."""
    return FEED_FLOOR * settings.layer_height * settings.speed / settings.speed_max


def _runs(
    pieces: Pieces, height: np.ndarray, speed: np.ndarray, layer: int, settings: PlanSettings
) -> list[Run]:
    """Deposits, one run per chain; indices are set later."""
    start, end = (list(map(tuple, side.tolist())) for side in (pieces.start, pieces.end))
    rows = zip(
        start,
        end,
        pieces.bead.tolist(),
        pieces.chain.tolist(),
        height.tolist(),
        np.round(speed, 9).tolist(),
        strict=True,
    )
    out: list[Run] = []
    before, last = None, None
    for a, b, bead, chain, h, v in rows:
        if chain != before:
            out.append([])
            before, last = chain, None
        if last is not None and last == a:
            a = last  # one tuple where two pieces meet
        out[-1].append(_deposit(a, b, layer, bead, h, v, settings))
        last = b
    return out


def _deposit(
    a: Point, b: Point, layer: int, bead: int, h: float, v: float, settings: PlanSettings
) -> Segment:
    return Segment(
        0,
        Kind.DEPOSIT,
        a,
        b,
        v,
        layer=layer,
        bead=bead,
        arc=True,
        height=h,
        width=settings.bead_width,
        speed_programmed=v,
    )


def connected(
    runs: list[Run], layer: int, ceiling: Ceiling, safe_z: float, settings: PlanSettings
) -> list[Segment]:
    """All runs with idle moves between them, from safe height to safe height, numbered from 0."""
    out: list[Segment] = []
    if runs:
        out += leg((*runs[0][0].start[:2], safe_z), runs[0][0].start, settings, layer)
    for run, following in zip(runs, [*runs[1:], None], strict=True):
        out += _with_leads(run, settings)
        end = run[-1].end
        after = following[0].start if following else (*end[:2], safe_z)
        z = ceiling.above(end, after) + settings.clearance if following else safe_z
        moves = hop(end, after, min(max(z, end[2] + settings.clearance), safe_z), settings, layer)
        out += _rested(moves, run, settings)
    for i, s in enumerate(out):
        object.__setattr__(s, 'index', i)  # fresh objects that nobody else holds yet
    return out


def relaid(
    segments: list[Segment],
    z: float,
    layer: int,
    ceiling: Ceiling,
    safe_z: float,
    settings: PlanSettings,
) -> list[Segment]:
    """A planned layer at height z (m): the same runs, already put out before their ends, with new ways between them."""
    runs: list[Run] = []
    between = True
    for s in segments:
        if not (s.arc or _is_tail(s)):
            between = True
        elif s.length > 0:
            if between:
                runs.append([])
            between = False
            runs[-1].append(s.at(start=(*s.start[:2], z), end=(*s.end[:2], z), layer=layer))
    return connected(runs, layer, ceiling, safe_z, replace(settings, lead_off=0.0))


def _is_tail(s: Segment) -> bool:
    """The end of a run that is travelled without arc has the width of its bead; ways between runs have none."""
    return s.kind == Kind.IDLE and s.width > 0


def _with_leads(run: Run, settings: PlanSettings) -> list[Segment]:
    """The run with the arc lit before it moves and put out before the end of the path.

    What burns before the way has the feed and voltage of the first piece: a loop corrects deposits only.
    """
    out = list(run)
    if settings.lead_off > 0:
        out = _tail(out, settings.lead_off)
    if settings.lead_on > 0:
        first = run[0]
        lit = first.at(
            kind=Kind.DWELL,
            end=first.start,
            dwell=settings.lead_on,
            height=0.0,
            wire_feed_speed=base_feed(first, settings),
            voltage=settings.voltage,
        )
        out.insert(0, lit)
    return out


def _tail(run: Run, length: float) -> list[Segment]:
    """The last `length` (m) of a run without arc, at most a quarter of it."""
    length = min(length, sum(s.length for s in run) / 4)
    out = list(run)
    tail: list[Segment] = []
    while length > 1e-6:
        s = out.pop()
        share = max(0.0, 1 - length / s.length) if s.length > 0 else 0.0
        cut = tuple(a + share * (b - a) for a, b in zip(s.start, s.end, strict=True))
        if share > 0:
            out.append(s.at(end=cut))
        tail.insert(0, s.at(start=cut, kind=Kind.IDLE, arc=False, height=0.0, bead=0))
        length -= s.length * (1 - share)
    return out + tail


def _rested(moves: list[Segment], run: Run, settings: PlanSettings) -> list[Segment]:
    """Moves with a dwell after the lift when the bead took less time than settings.bead_time."""
    if settings.bead_time <= 0 or not moves:
        return moves
    pause = settings.bead_time - sum(s.duration for s in run)
    if pause <= 0:
        return moves
    top = max(m.end[2] for m in moves)
    k = next(i for i, m in enumerate(moves) if m.end[2] >= top - 1e-9) + 1
    place = moves[k - 1].end
    rest = Segment(
        0, Kind.DWELL, place, place, settings.idle_speed, layer=run[0].layer, dwell=pause
    )
    return [*moves[:k], rest, *moves[k:]]
