"""Where torch and positioner are along a program's moves, and how far corners may be rounded off."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from waam_plan.gcode.compact import Move
from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import Course, RobotProgramError, course
from waam_process.segment import Kind, Point
from waam_robot.frames import pose_from_wpr, rotation, wpr
from waam_robot.split import split, turn_angle

STEP = 2e-3  # m between the points at which the turn of C is looked at
WIDEST_TURN = math.radians(75)  # of C in one move: controllers turn the torch the shorter way
SHORTEST_ZONE = 0.01e-3  # m; below it the robot stops in a corner
FIRST, INNER, LAST = 0, 1, 2


@dataclass(frozen=True)
class Pose:
    """place: m, work frame; wpr: W, P, R of the tool, rad; external: B, C, rad, empty without positioner."""

    place: Point
    wpr: Point
    external: tuple[float, ...] = ()


@dataclass(frozen=True)
class Step:
    """A move with poses. zone: m before its end at which the next one may begin; bend: |difference of the directions|
    there (0 ... 2); role: FIRST, INNER or LAST bead of the layer."""

    move: Move
    end: Pose
    via: Pose | None
    zone: float
    bend: float
    role: int


def steps(moves: list[Move], cell: RobotCell) -> tuple[Pose, list[Step]]:
    """The pose at the start and the moves with theirs. RobotProgramError where the positioner cannot turn so far."""
    if cell.positioner == 'turn':
        moves, turns = _turned(moves, cell)
    elif cell.positioner == 'place':
        moves, turns = _by_place(moves, cell)
    else:
        hold = -math.radians(cell.turn_zero_deg)
        turns = [(hold, hold, hold)] * len(moves)
    _check_turns(moves, turns, cell)
    upright = moves[0].segment.tool_axis
    start = _pose(moves[0].start, upright, turns[0][0], cell)
    corners = _corners(moves, cell)
    roles = _roles(moves)
    out = []
    for move, (_, middle, end), (zone, bend), role in zip(
        moves, turns, corners, roles, strict=True
    ):
        axis = move.segment.tool_axis
        via = _pose(move.via, axis, middle, cell) if move.via else None
        out.append(Step(move, _pose(move.end, axis, end, cell), via, zone, bend, role))
    return start, out


# ---- torch and positioner ------------------------------------------------------------------------


def _pose(place: Point, axis: Point, c: float, cell: RobotCell) -> Pose:
    """The torch along `axis`, its x as near as possible to that of `orientation` as the robot sees it."""
    toward = pose_from_wpr(np.zeros(3), np.radians(cell.orientation))[:3, 0]
    if not cell.axes:
        return Pose(place, _wpr(np.array(axis), toward))
    zero = math.radians(cell.turn_zero_deg)
    seen = rotation(2, -(c + zero))[:3, :3] @ np.array(axis)
    b = math.atan2(seen[0], seen[2]) if cell.positioner == 'turn' else 0.0
    tilt = cell.device.faceplate(b)[:3, :3]
    to_robot = tilt @ rotation(2, -(c + zero))[:3, :3]
    return Pose(place, _wpr(np.array(axis), to_robot.T @ toward), (b, c))


def _wpr(axis: np.ndarray, toward: np.ndarray) -> Point:
    z = -axis / np.linalg.norm(axis)
    x = toward - (z @ toward) * z
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2] = x, np.cross(z, x), z
    w, p, r = wpr(frame).tolist()
    return (w, p, r)


Turns = tuple[float, float, float]  # C at start, via and end


def _turned(moves: list[Move], cell: RobotCell) -> tuple[list[Move], list[Turns]]:
    """Moves, cut where C would turn too far in one, and C along them.

    C begins and ends where it stands still, so that programs can follow each other in any order. In the last idle move
    before a bead it goes to the robot's side of the bead's start.
    """
    home = -math.radians(cell.turn_zero_deg)
    groups = [(arc, list(g)) for arc, g in groupby(moves, key=lambda m: m.segment.arc)]
    c = home
    found: list[tuple[Move, Turns]] = []
    if groups[0][0]:
        aim = _station(moves[0].start, c, cell)
        found, c = [(_standing(moves[0], moves[0].start), (c, 0.5 * (c + aim), aim))], aim
    for n, (arc, group) in enumerate(groups):
        if arc:
            turns = _bead_turns(group, c, cell)
        else:
            after = groups[n + 1][1][0].start if n + 1 < len(groups) else None
            turns = _idle_turns(group, c, c if after is None else _station(after, c, cell))
        found += zip(group, turns, strict=True)
        c = turns[-1][2]
    if c != home:
        found.append((_standing(moves[-1], moves[-1].end), (c, 0.5 * (c + home), home)))
    cut = [part for move, turn in found for part in _cut(move, turn)]
    return [move for move, _ in cut], [turn for _, turn in cut]


def _by_place(moves: list[Move], cell: RobotCell) -> tuple[list[Move], list[Turns]]:
    """As `_turned`, with C as a function of the place: programs can follow each other in any order then."""
    found = []
    for move in moves:
        if any(move.segment.tool_axis[:2]):
            raise RobotProgramError("positioner 'place' is for an upright torch")
        way = course(move.start, move)
        x, y, z = way.at(np.array([way.length / 2]))[0].tolist()
        turn = (cell.turn_at(move.start), cell.turn_at((x, y, z)), cell.turn_at(move.end))
        found += list(_cut(move, turn))
    return [move for move, _ in found], [turn for _, turn in found]


def _standing(move: Move, place: Point) -> Move:
    """A move of the positioner alone."""
    still = move.segment.at(kind=Kind.IDLE, arc=False, start=place, end=place, height=0.0, bead=0)
    return Move(place, place, still)


def _idle_turns(moves: list[Move], c: float, aim: float) -> list[Turns]:
    """C stands until the last move, which brings it to `aim`; a dwell after it waits there."""
    travels = [i for i, m in enumerate(moves) if m.segment.kind != Kind.DWELL]
    last = travels[-1] if travels else len(moves)
    turns = []
    for i in range(len(moves)):
        end = aim if i >= last else c
        turns.append((c, 0.5 * (c + end), end))
        c = end
    return turns


def _station(place: Point, near: float, cell: RobotCell) -> float:
    """C that brings a place to the robot's side, the turn next to `near`."""
    flat = np.array([place]) + np.array(cell.origin)
    c = float(turn_angle(flat)[0])
    return c + 2 * math.pi * round((near - c) / (2 * math.pi))


def _bead_turns(moves: list[Move], c: float, cell: RobotCell) -> list[Turns]:
    """C at start, via and end of moves with the arc on, by the split."""
    points, counts = [np.array(moves[0].start)[None]], []
    for move in moves:
        way = course(move.start, move)
        n = max(2, 2 * math.ceil(way.length / STEP / 2))
        counts.append(n)
        points.append(way.at(way.length * np.arange(1, n + 1) / n))
    places = np.concatenate(points) + np.array(cell.origin)
    poses = np.broadcast_to(np.eye(4), (len(places), 4, 4)).copy()
    poses[:, :3, 3] = places
    along = split(poses, cell.device, cell.limits, c).c
    ends = np.cumsum([0, *counts])
    return [
        (float(along[a]), float(along[(a + b) // 2]), float(along[b]))
        for a, b in zip(ends, ends[1:], strict=False)
    ]


def _cut(move: Move, turn: Turns) -> Iterator[tuple[Move, Turns]]:
    """A move in as many equal parts as keep C below the widest turn."""
    first, _, last = turn
    n = math.ceil(abs(last - first) / WIDEST_TURN)
    if n <= 1:
        yield move, turn
        return
    way = course(move.start, move)
    marks = way.at(way.length * np.arange(2 * n + 1) / (2 * n)).tolist()
    angles = np.linspace(first, last, 2 * n + 1).tolist()
    for k in range(n):
        a, m, b = (tuple(marks[2 * k + i]) for i in range(3))
        part = replace(
            move,
            start=a,
            end=b,
            via=m if move.via else None,
            segment=move.segment.at(start=a, end=b),
        )
        yield part, (angles[2 * k], angles[2 * k + 1], angles[2 * k + 2])


def _check_turns(moves: list[Move], turns: list[Turns], cell: RobotCell) -> None:
    if not cell.axes:
        return
    for move, turn in zip(moves, turns, strict=True):
        degrees = math.degrees(turn[2])
        if not cell.turn_low_deg <= degrees <= cell.turn_high_deg:
            x, y, z = (v * 1e3 for v in move.end)
            raise RobotProgramError(
                f'layer {move.segment.layer} at ({x:.1f}, {y:.1f}, {z:.1f}) mm: the positioner would turn to '
                f'{degrees:.0f} deg, its range is {cell.turn_low_deg:.0f} to {cell.turn_high_deg:.0f}'
            )


# ---- corners and roles ---------------------------------------------------------------------------


def _corners(moves: list[Move], cell: RobotCell) -> list[tuple[float, float]]:
    """(zone, bend) at the end of every move: 0 where the robot has to stop.

    A corner that is rounded off by a parabola from `zone` before it to `zone` after it is missed by zone * bend / 4,
    and by zone^2 / 4 times the curvature of arcs beside it.
    """
    ways = [None if m.segment.kind == Kind.DWELL else course(m.start, m) for m in moves]
    out = []
    for n, move in enumerate(moves):
        after = n + 1 < len(moves) and moves[n + 1].segment.arc and move.segment.arc
        here, there = ways[n], ways[n + 1] if after else None
        out.append((0.0, 0.0) if here is None or there is None else _corner(here, there, cell))
    return out


def _corner(here: Course, there: Course, cell: RobotCell) -> tuple[float, float]:
    bend = float(np.linalg.norm(there.tangents()[0] - here.tangents()[1]))
    curve = max(here.curvature, there.curvature)
    zone = min(cell.zone, here.length / 2, there.length / 2)
    if (bend + zone * curve) * zone > 4 * cell.corner:
        # zone (bend + zone curve) = 4 corner, in the form that does not divide by the curvature
        zone = 8 * cell.corner / (bend + math.sqrt(bend**2 + 16 * cell.corner * curve))
    return (math.floor(zone * 1e5 + 1e-9) / 1e5 if zone >= SHORTEST_ZONE else 0.0), bend


def _roles(moves: list[Move]) -> list[int]:
    """By the order of the beads in the layer: first, inner, last."""
    beads = {m.segment.bead for m in moves if m.segment.kind == Kind.DEPOSIT}
    first, last = (min(beads), max(beads)) if beads else (0, 0)

    def role(bead: int) -> int:
        if bead == first:
            return FIRST
        return LAST if bead == last else INNER

    return [role(m.segment.bead) for m in moves]
