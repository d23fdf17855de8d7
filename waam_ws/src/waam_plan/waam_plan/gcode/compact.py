"""Compact programs: arcs and long lines instead of chords, and equal layers written once.

Small programs and their limits are those of source 003, chapter 5 (docs/equations.md, S3)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from waam_plan.plan import Plan, PlannedLayer
from waam_process.segment import Kind, Point, Segment

TOLERANCE = 0.02e-3  # m, largest distance between program and path
SAME = 0.03  # setpoints that differ by less than this share are one
LONGEST_RADIUS = 5.0  # m; flatter arcs are lines
WIDEST = math.radians(300)  # an arc ends before its ends meet
EQUAL = 1e-6  # m, between the paths of two layers that are written once
STRAIGHT = 0.9999  # cosine of the turn between two pieces of one leg


@dataclass(frozen=True)
class Move:
    """A line to `end`, or with `via` the arc through it. `segment` holds the setpoints; metal is that of all pieces."""

    start: Point
    end: Point
    segment: Segment
    via: Point | None = None
    pieces: int = 1

    @property
    def points(self) -> int:
        """Positions that a robot's program needs for it, besides the start."""
        if self.segment.kind == Kind.DWELL:
            return 0
        return 2 if self.via else 1


@dataclass(frozen=True)
class Fragment:
    """Moves of one or more layers that are equal but for their height. levels: (layer number, shift in z, m)."""

    moves: list[Move]
    levels: list[tuple[int, float]]


@dataclass(frozen=True)
class Saving:
    """Positions of the program before and after; `share` is what was saved."""

    before: int
    after: int

    @property
    def share(self) -> float:
        """Of the positions; 0 for an empty program."""
        return 1.0 - self.after / self.before if self.before else 0.0


def compact(
    segments: list[Segment], tolerance: float = TOLERANCE, legs: bool = False
) -> list[Move]:
    """Moves whose path keeps within `tolerance` (m) of the segments', in the same order.

    Only deposits with the same setpoints (within 3 %) are joined; their metal per length becomes the mean. With `legs`
    a straight idle leg, pieces of the harmonic law, is one move at its highest speed, for robots that accelerate by
    themselves.
    """
    out: list[Move] = []
    for run in _runs(segments, legs):
        out.extend(_fit(run, tolerance))
    return out


def _runs(segments: list[Segment], legs: bool) -> Iterator[list[Segment]]:
    """Consecutive segments that may become one move."""
    run: list[Segment] = []
    for s in segments:
        if run and not _joins(run[0], run[-1], s, legs):
            yield run
            run = []
        run.append(s)
    if run:
        yield run


def _joins(first: Segment, last: Segment, s: Segment, legs: bool) -> bool:
    same = (s.kind, s.arc, s.tool_axis) == (first.kind, first.arc, first.tool_axis)
    if not same or math.dist(last.end, s.start) > EQUAL:
        return False
    if s.kind != Kind.DEPOSIT:
        return legs and s.kind == Kind.IDLE and _straight(last, s)
    values = (
        (getattr(first, k), getattr(s, k))
        for k in ('speed', 'height', 'wire_feed_speed', 'voltage')
    )
    return all(abs(a - b) <= SAME * max(abs(a), abs(b)) for a, b in values)


def _straight(before: Segment, after: Segment) -> bool:
    """One goes on in the direction of the other, so that the end of a leg stays where it is."""
    a, b = np.subtract(before.end, before.start), np.subtract(after.end, after.start)
    return float(a @ b) > STRAIGHT * float(np.linalg.norm(a) * np.linalg.norm(b))


def _fit(run: list[Segment], tolerance: float) -> list[Move]:
    points = np.array([run[0].start, *(s.end for s in run)])
    curved = run[0].kind == Kind.DEPOSIT
    moves, i = [], 0
    while i < len(run):
        line = _farthest(points, i, tolerance, _is_line)
        j, via = line, None
        arc = _farthest(points, i, tolerance, _is_arc) if curved and len(run) - i >= 3 else i
        if arc > line + 1:
            j, via = arc, tuple(points[(i + arc) // 2].tolist())
        moves.append(Move(run[i].start, run[j - 1].end, _mean(run[i:j]), via, j - i))
        i = j
    return moves


def _farthest(
    points: np.ndarray, i: int, tolerance: float, fits: Callable[[np.ndarray, float], bool]
) -> int:
    """Largest j such that points i..j are one move, found by doubling and halving."""
    good, step = i + 1, 1
    while good + step < len(points) and fits(points[i : good + step + 1], tolerance):
        good, step = good + step, 2 * step
    while step > 1:
        step //= 2
        if good + step < len(points) and fits(points[i : good + step + 1], tolerance):
            good += step
    return good


def _is_line(p: np.ndarray, tolerance: float) -> bool:
    along = p[-1] - p[0]
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return False
    unit = along / length
    t = (p - p[0]) @ unit
    off = np.linalg.norm(p - p[0] - t[:, None] * unit, axis=1)
    return bool(off.max() <= tolerance and (np.diff(t) > 0).all())


def circle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the circle through three points (m); infinite radius when they lie on a line."""
    u, v = b - a, c - a
    normal = np.cross(u, v)
    square = float(normal @ normal)
    if square < 1e-24:
        return np.full(3, np.nan), math.inf
    centre = a + (np.cross(normal, u) * (v @ v) + np.cross(v, normal) * (u @ u)) / (2 * square)
    return centre, float(np.linalg.norm(centre - a))


def _is_arc(p: np.ndarray, tolerance: float) -> bool:
    """Points and middles of their chords lie on the circle, in one sense, at one height, not all the way round."""
    if len(p) < 4:
        return True  # three points always lie on a circle; more are checked
    if np.ptp(p[:, 2]) > EQUAL:
        return False
    centre, radius = circle(p[0], p[len(p) // 2], p[-1])
    if not radius < LONGEST_RADIUS:
        return False
    middles = 0.5 * (p[:-1] + p[1:])
    for q in (p, middles):
        if np.abs(np.linalg.norm(q - centre, axis=1) - radius).max() > tolerance:
            return False
    turns = np.diff(np.unwrap(np.arctan2(p[:, 1] - centre[1], p[:, 0] - centre[0])))
    return bool((np.sign(turns) == np.sign(turns[0])).all() and abs(turns.sum()) < WIDEST)


def _mean(run: list[Segment]) -> Segment:
    """Setpoints of a joined run: speeds, metal and feed as means over the length; idle, the highest speed."""
    if len(run) == 1:
        return run[0]
    if run[0].kind == Kind.IDLE:
        fastest = max(s.speed for s in run)
        return run[0].at(end=run[-1].end, speed=fastest, speed_programmed=fastest)
    weights = np.array([s.length for s in run])
    mean = {
        k: float(np.average([getattr(s, k) for s in run], weights=weights))
        for k in ('speed', 'height', 'speed_programmed', 'wire_feed_speed', 'voltage')
    }
    return run[0].at(end=run[-1].end, **mean)


def fragments(plan: Plan, tolerance: float = TOLERANCE) -> list[Fragment]:
    """The plan's layers, those with equal paths and metal written once, in the order of their first layer."""
    out: list[Fragment] = []
    known: list[tuple[PlannedLayer, np.ndarray]] = []
    for layer in plan.layers:
        shape = _shape(layer)
        for k, (_, other) in enumerate(known):
            if shape.shape == other.shape and np.abs(shape - other).max(initial=0.0) <= EQUAL:
                lift = layer.deposits[0].start[2] - known[k][0].deposits[0].start[2]
                out[k].levels.append((layer.number, float(lift)))
                break
        else:
            known.append((layer, shape))
            moves = compact(layer.segments, tolerance, legs=True)
            out.append(Fragment(moves, [(layer.number, 0.0)]))
    for k, fragment in enumerate(out):
        if len(fragment.levels) > 1:
            out[k] = _low(fragment, known[k][0], plan.settings.clearance)
    return out


def _low(fragment: Fragment, layer: PlannedLayer, clearance: float) -> Fragment:
    """Idle moves just above the layer itself: lifted with it they stay inside the machine, and nothing is higher."""
    top = float(np.nanmax(layer.target_after)) + clearance

    def lowered(p: Point) -> Point:
        return (p[0], p[1], min(p[2], top))

    moves = [replace(m, start=lowered(m.start), end=lowered(m.end)) for m in fragment.moves]
    stays = [m for m in moves if m.via or m.start != m.end or m.segment.kind == Kind.DWELL]
    return Fragment(stays, fragment.levels)


def _shape(layer: PlannedLayer) -> np.ndarray:
    """(n, 10): ends relative to the layer's height, metal, speed, dwell, arc; idle moves count in plan view, so upright
    ones do not: they have more pieces the longer they are."""
    deposits = layer.deposits
    low = deposits[0].start[2] if deposits else 0.0
    rows = []
    for s in layer.segments:
        if s.kind == Kind.IDLE and math.dist(s.start[:2], s.end[:2]) <= EQUAL:
            continue
        z = (s.start[2] - low, s.end[2] - low) if s.kind == Kind.DEPOSIT else (0.0, 0.0)
        rows.append((*s.start[:2], z[0], *s.end[:2], z[1], s.height, s.speed, s.dwell, s.arc))
    return np.array(rows).reshape(-1, 10)


def saving(plan: Plan, found: list[Fragment]) -> Saving:
    """Positions of a robot's program: one per layer with a line to every point, and in the fragments.

    Counted by one rule: where it begins, one for a line, two for an arc, one for a straight idle leg.
    """
    before = sum(1 + len(p.deposits) + _legs(p) for p in plan.layers)
    after = sum(1 + sum(m.points for m in f.moves) for f in found)
    return Saving(before, after)


def _legs(layer: PlannedLayer) -> int:
    idle = [s for s in layer.segments if s.kind == Kind.IDLE]
    return len(compact(idle, legs=True))
