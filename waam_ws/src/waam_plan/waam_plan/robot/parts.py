"""A plan as programs: fragments of limited size, called in order and lifted where layers are equal."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from waam_plan.gcode.compact import Fragment, Move, fragments
from waam_plan.gcode.program import with_base_feed
from waam_plan.plan import Plan
from waam_plan.robot.motion import RobotProgramError
from waam_process.segment import Kind, Segment

POINTS = 2000  # of a program that is called, S3 chapter 4
BYTES = 600_000  # of its text
ALL_POINTS = 425_773  # of all of them: what the controller's memory holds
ALL_BYTES = 127_732_000
SHARE = 0.7  # of POINTS that the planner fills: moves may be cut where the positioner turns far

Call = tuple[str, float]  # program, lift in m
Setpoints = tuple[float, float, float]  # travel m/s, wire m/min, V


@dataclass(frozen=True)
class Programs:
    """texts: of every program that is called, by name; calls: in the order of the layers."""

    texts: dict[str, list[str]]
    calls: list[Call]


def programs(
    plan: Plan, name: str, tolerance: float, write: Callable[[str, list[Move]], list[str]]
) -> Programs:
    """write(program name, moves) gives the texts of one program. RobotProgramError for a name that no robot takes and
    beyond the limits of memory."""
    if not re.fullmatch(r'[A-Z][A-Z0-9_]{0,19}', name):
        raise RobotProgramError(
            f"'{name}' is no program name: capital letters, digits and _, at most 20"
        )
    texts: dict[str, list[str]] = {}
    calls: dict[int, list[Call]] = {}
    total = 0
    for fragment in fragments(_with_feeds(plan), tolerance):
        written = []
        for moves in _split(fragment):
            part = f'{name}{len(texts) + 1:03d}'
            texts[part] = write(part, moves)
            total += _points(moves)
            written.append(part)
        for number, lift in fragment.levels:
            calls[number] = [(part, lift) for part in written]
    _check_memory(texts, total)
    return Programs(texts, [c for number in sorted(calls) for c in calls[number]])


def _with_feeds(plan: Plan) -> Plan:
    layers = [replace(p, segments=with_base_feed(p.segments, plan.settings)) for p in plan.layers]
    return replace(plan, layers=layers)


def _split(fragment: Fragment) -> list[list[Move]]:
    """Pieces within the limits of the controller; cut only where the arc is off."""
    out: list[list[Move]] = [[]]
    block: list[Move] = []
    for move in [*fragment.moves, None]:
        if move is not None:
            block.append(move)
        ends = move is None or not move.segment.arc
        if ends and block:
            if out[-1] and _points(out[-1]) + _points(block) > SHARE * POINTS:
                out.append([])
            out[-1].extend(block)
            block = []
    for moves in out:
        if _points(moves) > POINTS:
            raise RobotProgramError(
                f'a bead of {_points(moves)} points does not fit into a fragment of {POINTS}; '
                'raise the tolerance (--tolerance)'
            )
    return out


def _points(moves: list[Move]) -> int:
    return 1 + sum(m.points for m in moves)


def setpoints(s: Segment) -> Setpoints:
    """As they are written, rounded, so that equal ones are one record."""
    return round(s.speed, 6), round(s.wire_feed_speed * 60, 4), round(s.voltage, 2)


def welds(moves: list[Move]) -> list[Setpoints | None]:
    """Setpoints of every move with the arc on, None with the arc off. A dwell burns with those of the deposit after it,
    at the end of a bead with those of the one before."""
    out: list[Setpoints | None] = [
        setpoints(m.segment) if m.segment.arc and m.segment.kind == Kind.DEPOSIT else None
        for m in moves
    ]
    for order in (range(len(moves) - 2, -1, -1), range(1, len(moves))):
        for n in order:
            other = n + (1 if order.step < 0 else -1)
            if out[n] is None and moves[n].segment.arc and moves[other].segment.arc:
                out[n] = out[other]
    return out


def _check_memory(texts: dict[str, list[str]], points: int) -> None:
    total = 0
    for name, written in texts.items():
        size = sum(len(t) for t in written)
        total += size
        if size > BYTES:
            raise RobotProgramError(
                f'{name}: {size} bytes, the controller takes {BYTES} in one program; '
                'raise the tolerance (--tolerance)'
            )
    if total > ALL_BYTES or points > ALL_POINTS:
        raise RobotProgramError(
            f'{points} points in {total / 1e3:.0f} KB, the memory of a controller takes {ALL_POINTS} in '
            f'{ALL_BYTES // 1000} KB; raise the tolerance (--tolerance), or plan fewer layers (--layers) and load the '
            'rest later'
        )
