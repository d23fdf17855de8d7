"""After new wire was threaded: the torch goes back to where the arc went out, and lays the rest of its path from there.

The torch runs on without wire until the controller has noticed: 2 to 3 mm of bead would be missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from waam_process.segment import Point, Segment

from ..model.cell import Cell, Machine

BURNS_A = 30.0  # A: less is no arc (established_a of the controller)
OVERLAP = 1e-3  # m: the wire has stopped that much before the arc went out, at usual speeds
MIN_GAP, MAX_GAP = (
    0.5e-3,
    10e-3,
)  # m between arc and torch: less is no gap, more is no gap of this bead
CORNER = math.cos(math.radians(20.0))  # a way back that turns more would cut the corner
BACK_SPEED = 5e-3  # m/s


def place_behind(segments: list[Segment], torch: Point, length: float) -> Point:
    """The point of the path `length` m behind the torch, which stands on the last of the segments; not beyond the
    beginning of the arc or a corner."""
    last = segments[-1]
    heading = _direction(last.start, last.end)
    here = torch
    for segment in reversed(segments):
        if not segment.arc or _dot(_direction(segment.start, segment.end), heading) < CORNER:
            break
        way = math.dist(segment.start, here)
        if way > 0.0 and way >= length:
            share = length / way
            x, y, z = (h + share * (s - h) for h, s in zip(here, segment.start, strict=True))
            return x, y, z
        length -= way
        here = segment.start
    return here


def _direction(a: Point, b: Point) -> Point:
    size = math.dist(a, b) or 1.0
    x, y, z = ((q - p) / size for p, q in zip(a, b, strict=True))
    return x, y, z


def _dot(a: Point, b: Point) -> float:
    return sum(p * q for p, q in zip(a, b, strict=True))


class Again:
    """The path that is being laid; `until(condition, timeout, text)` waits for a state of the machine."""

    def __init__(
        self,
        cell: Cell,
        job_id: str,
        segments: list[Segment],
        until: Callable[[Callable[[Machine], bool], float, str], None],
    ) -> None:
        self.cell, self.job_id, self.segments, self.until = cell, job_id, segments, until

    def gap(self, held: Machine) -> float:
        """m of path between the place where current was seen last and the torch; 0 = there is none that can be laid
        again."""
        done = held.executed if held.executed_job == self.job_id else -1
        running = next((s for s in self.segments if s.index > done), None)
        if held.burned is None or running is None or not running.arc:
            return 0.0
        way = math.dist(held.burned, held.position)
        if not MIN_GAP <= way <= MAX_GAP:
            return 0.0
        laid = [s for s in self.segments if s.index <= done]
        back = place_behind([*laid, running], held.position, way)
        return way if math.dist(back, held.position) >= MIN_GAP else 0.0  # the bead begins here

    def lay(self, held: Machine, stop: Callable[[], None]) -> None:
        """stop: ends the hold and drops the queue. Then the torch goes back, and the rest is handed over anew under the
        same indices. Raises JobError."""
        done = held.executed if held.executed_job == self.job_id else -1
        rest = [s for s in self.segments if s.index > done]
        laid = [s for s in self.segments if s.index <= done]
        place = place_behind([*laid, rest[0]], held.position, self.gap(held) + OVERLAP)
        stop()
        self.until(lambda m: m.state == 'IDLE', 10.0, 'the machine did not come to rest')
        here = self.cell.machine().position
        move = tuple(p - h for p, h in zip(place, here, strict=True))
        x, y, z = move
        self.cell.command('JOG', vector=(x, y, z), value=BACK_SPEED)
        self.until(
            lambda m: m.state == 'IDLE' and math.dist(m.position, place) < 0.1e-3,
            20.0,
            'the torch did not go back to where the arc went out',
        )
        start = self.cell.machine().position
        self.cell.enqueue(self.job_id, [rest[0].at(start=start), *rest[1:]], True)
