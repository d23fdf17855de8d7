"""Hands segments to the bridge and waits until they are done; knows where the torch is and which index comes next."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from waam_process.segment import Point, Segment

from ..model.cell import Cell, Machine
from ..model.goal import Code, JobError
from .again import Again
from .watch import Watch

HOME_SPEED = 0.01  # m/s, the slowest that an axis seeks its switch with


class Motion:
    """All waiting goes through the watch, so every fault, pause and abort is noticed here as well."""

    def __init__(self, cell: Cell, watch: Watch, job_id: str) -> None:
        self.cell, self.watch, self.job_id = cell, watch, job_id
        self.next_index = 1
        self.position: Point = (0.0, 0.0, 0.0)

    def now(self) -> float:
        """s of ROS time without the pauses."""
        return self.cell.now() - self.watch.held

    def until(self, condition: Callable[[Machine], bool], timeout: float, text: str) -> None:
        """Waits for a state of the machine, at most `timeout` s of ROS time."""
        end = self.now() + timeout
        while not condition(self.watch.tick()):
            if self.now() > end:
                raise JobError(Code.TIMEOUT, f'{text} within {timeout:.0f} s')

    def home(self, timeout: float) -> None:
        """References the axes when that was not done yet. timeout: s, beside the way of the axes to their switches."""
        machine = self.cell.machine()
        if not machine.homed:
            low, high = machine.limit_min, machine.limit_max
            timeout += sum(b - a for a, b in zip(low, high, strict=True)) / HOME_SPEED
            self.cell.command('HOME')
            self.until(lambda m: m.homed, timeout, 'homing did not end')
        self.until(lambda m: m.state == 'IDLE', timeout, 'the machine did not come to rest')

    def execute(
        self, segments: list[Segment], on_done: Sequence[Callable[[Segment], None]] = ()
    ) -> None:
        """Runs consecutive segments; calls all of `on_done` with each newly finished one (the last of several)."""
        self.cell.enqueue(self.job_id, segments, True)
        self.watch.again = Again(self.cell, self.job_id, segments, self.until)
        try:
            self._await(segments, on_done)
        finally:
            self.watch.again = None
        self.next_index, self.position = segments[-1].index + 1, segments[-1].end

    def _await(self, segments: list[Segment], on_done: Sequence[Callable[[Segment], None]]) -> None:
        by_index = {s.index: s for s in segments}
        last, seen = segments[-1].index, -1
        # an override may stretch a segment tenfold; what a pause takes does not count
        allowed = 12.0 * max(s.duration for s in segments) + 120.0
        deadline = self.now() + allowed
        while True:
            machine = self.watch.tick()
            done = machine.executed if machine.executed_job == self.job_id else -1
            if done != seen:
                seen, deadline = done, self.now() + allowed
                for told in on_done if done in by_index else ():
                    told(by_index[done])
            if done >= last and machine.state == 'IDLE':
                break
            if self.now() > deadline:
                text = f'no segment was finished for {allowed:.0f} s: {done} of {last} are done'
                raise JobError(Code.TIMEOUT, text)
