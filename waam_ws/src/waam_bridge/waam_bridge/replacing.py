"""Other setpoints for segments that wait in the bridge: which of them are still here, and how their lines take the
place of the old ones. Pure.

A line that was written to the controller once keeps what it says, whatever becomes of it on the way: only segments of
which no line was ever written are replaced, and all behind them with them. So every number stands for one line, and
none is missing or there twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from waam_process.segment import Point, Segment

from . import batches, program
from .machine import Machine
from .program import Limits, Modal, Permit, Refusal, Waiting

PATH = ('index', 'kind', 'start', 'end', 'layer', 'bead', 'arc', 'dwell', 'tool_axis')
AHEAD = 8  # lines that may be written while a replacement is worked out; doubled when it was late
TRIES = 5


class Late(Exception):
    """The first line that was to be replaced has been written meanwhile."""


@dataclass(frozen=True)
class Exchange:
    """What a replacement is checked against, taken at one moment; void when the bridge's `generation` has moved on."""

    generation: int
    waiting: tuple[
        Waiting, ...
    ]  # that are to be replaced, up to the last one; empty = none is left
    offset: Point  # m, work zero in machine coordinates
    limits: Limits
    pace: program.Pace = program.as_programmed

    @property
    def first(self) -> int:
        """Index of the first segment that is replaced; 0 = none is."""
        return self.waiting[0].segment.index if self.waiting else 0


def permit(machine: Machine, job: str, segments: Sequence[Segment], ahead: int = AHEAD) -> Exchange:
    """What can be replaced now, if `ahead` more lines are written meanwhile. Raises Refusal."""
    offset = batches.check_state(machine, job)
    if job != machine.modal.job or machine.modal.index is None:
        raise Refusal(program.WRONG_STATE, f"no segments of job '{job}' wait")
    if not segments:
        raise Refusal(program.BAD_SEGMENT, 'segments is empty')
    for before, after in zip(segments, segments[1:], strict=False):
        if after.index != before.index + 1:
            text = f'segment {after.index} does not follow segment {before.index}'
            raise Refusal(program.GAP, text)
    if segments[-1].index != machine.modal.index:
        text = f'segment {segments[-1].index} is not the last one that waits, {machine.modal.index}'
        raise Refusal(program.GAP, text)
    free, lowest = machine.link.sender.written + ahead, segments[0].index
    kept = [w for w in machine.waiting if w.seq > free and w.segment.index >= lowest]
    limits = machine.params.limits(machine.link.who.limits_mm)
    return Exchange(machine.generation, tuple(kept), offset, limits, machine.pace)


def prepare(exchange: Exchange, segments: Sequence[Segment], last: bool) -> program.Batch:
    """The lines of the segments that are replaced; nothing changes anywhere else. Raises Refusal for another path and
    for setpoints that `Enqueue` would refuse, too; `last` as there."""
    if not exchange.waiting:
        return program.Batch([], Modal(), 0, 0)
    modal = exchange.waiting[0].before
    new = segments[exchange.first - segments[0].index :]
    for old, s in zip(exchange.waiting, new, strict=True):
        for name in PATH:
            was, now = getattr(old.segment, name), getattr(s, name)
            if was != now:
                text = f'segment {s.index}: {name} is {now}, that of the one that waits {was}'
                raise Refusal(program.BAD_SEGMENT, text)
    known = exchange.first - 1
    granted = Permit(
        exchange.generation,
        modal,
        known,
        modal.end,
        exchange.offset,
        exchange.limits,
        exchange.pace,
    )
    return program.prepare(granted, list(new), last)


def commit(machine: Machine, exchange: Exchange, batch: program.Batch) -> None:
    """Puts the new lines in the place of the old ones. Raises Late, or Refusal when the queue was another meanwhile."""
    if exchange.generation != machine.generation or not machine.connected:
        raise Refusal(program.WRONG_STATE, f'interrupted: {machine.message}')
    if not exchange.waiting:
        return
    first = exchange.waiting[0].seq
    if machine.link.sender.written >= first:
        raise Late
    machine.link.sender.cut(first)
    while machine.waiting and machine.waiting[-1].seq >= first:
        machine.waiting.pop()
    machine.generation += 1  # what was checked against the old words is void
    batches.append(machine, batch)


def replace(machine: Machine, job: str, segments: Sequence[Segment], last: bool) -> tuple[int, int]:
    """All of it at once, where nothing else happens meanwhile. Returns the index of the first segment that was replaced
    and their number. Raises Refusal."""
    exchange = permit(machine, job, segments, ahead=0)
    batch = prepare(exchange, segments, last)
    commit(machine, exchange, batch)
    return exchange.first, batch.accepted
