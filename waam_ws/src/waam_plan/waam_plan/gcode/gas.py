"""When a program switches the shielding gas: pre-flow before the arc is lit, post-flow after it is out."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from itertools import accumulate, groupby

from waam_plan.gcode.compact import Move
from waam_process.segment import Kind


@dataclass(frozen=True)
class Flow:
    """Times in s. lead: from the end of the arc to the end of the bead's last move, unless that is a dwell."""

    pre: float
    post: float
    lead: float


@dataclass(frozen=True)
class Switch:
    """The gas goes on or off `before` seconds before the end of a move."""

    before: float
    on: bool


def gas_switches(moves: list[Move], flow: Flow) -> dict[int, list[Switch]]:
    """Index of a move with the arc off -> switches of the gas in it, in order. The gas is off before the first move.

    Times are those at programmed speed. The robot's own ramps make the moves longer, so the gas flows a little longer
    than set, never shorter. It stays on between beads that follow at once and where both switches would fall into one
    leg. Nothing is switched before the first bead or after the last where the moves are shorter than the flow.
    """
    out: dict[int, list[Switch]] = {}
    for arc, group in groupby(range(len(moves)), key=lambda i: moves[i].segment.arc):
        if not arc:
            for i, switch in _in_idle_run(moves, list(group), flow):
                out.setdefault(i, []).append(switch)
    return out


def gas_left(moves: list[Move], flow: Flow) -> float:
    """Seconds that the gas still has to flow after the last move; below 0 when it may be off already."""
    last = max(i for i, m in enumerate(moves) if m.segment.arc)
    return _delay(moves[last], flow) - sum(_duration(m) for m in moves[last + 1 :])


def _in_idle_run(moves: list[Move], run: list[int], flow: Flow) -> list[tuple[int, Switch]]:
    """run: indices of successive moves with the arc off."""
    ends = list(accumulate(_duration(moves[i]) for i in run))
    after_bead, before_bead = run[0] > 0, run[-1] < len(moves) - 1
    times: list[tuple[float, bool]] = []
    if after_bead:
        times.append((_delay(moves[run[0] - 1], flow), False))
    if before_bead:
        times.append((ends[-1] - flow.pre, True))
    if len(times) == 2 and times[1][0] <= times[0][0]:
        return []
    found = []
    for time, on in times:
        if 0 <= time <= ends[-1]:
            k = bisect_left(ends, time)
            found.append((run[k], Switch(ends[k] - time, on)))
    if len(found) == 2 and found[0][0] == found[1][0]:
        return found if moves[found[0][0]].segment.kind == Kind.DWELL else []
    return found


def _duration(move: Move) -> float:
    """s, of a move with the arc off at its programmed speed."""
    s = move.segment
    return s.dwell if s.kind == Kind.DWELL else math.dist(move.start, move.end) / s.speed


def _delay(bead_end: Move, flow: Flow) -> float:
    """s from the end of a bead's last move to the end of the post-flow."""
    return max(flow.post - (0.0 if bead_end.segment.kind == Kind.DWELL else flow.lead), 0.0)
