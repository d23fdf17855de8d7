"""From segments to the lines that the controller executes, with every check that a segment must pass first. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from waam_process.segment import Kind, Point, Segment, SegmentError
from waam_process.units import mm, to_mm, to_mm_min

# error codes of waam_msgs/srv/Enqueue
OK, NOT_CONNECTED, NOT_ARMED, BAD_SEGMENT, GAP, WRONG_STATE, QUEUE_FULL = 0, *range(300, 306)

CHAIN_TOLERANCE = 1e-5  # m, between the end of a segment and the start of the next
START_TOLERANCE = 5e-5  # m, between the machine's position and the start of the first one
LONGEST_DWELL = 600.0  # s; a longer one is a mistake, for the job waits without a dwell
STAYS_BEYOND = 0.525  # steps: the half one that the controller allows, and what a calibration of the steps changes
SLACK = 1e-9  # m, m/s, V: rounding at a limit is not a violation


class Refusal(ValueError):
    """Why a batch is refused; `code` is one of waam_msgs/srv/Enqueue."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


@dataclass(frozen=True)
class Limits:
    """What the machine and the source can do. SI; positions in machine coordinates."""

    low: Point
    high: Point
    speed_max: float
    arc_speed: tuple[float, float]
    wire_feed_speed: tuple[float, float]
    voltage: tuple[float, float]

    def reached(self, steps_per_mm: Point) -> Limits:
        """With what a motor may stand beyond a limit: homed, an axis is on its next whole step, and the controller lets
        it be half a step beyond."""
        x, y, z = (STAYS_BEYOND * mm(1.0 / steps) for steps in steps_per_mm)
        low, high = self.low, self.high
        return replace(
            self,
            low=(low[0] - x, low[1] - y, low[2] - z),
            high=(high[0] + x, high[1] + y, high[2] + z),
        )


@dataclass(frozen=True)
class Mark:
    """What is done when a line is executed."""

    job_id: str
    index: int
    layer: int
    bead: int


@dataclass(frozen=True)
class Modal:
    """What the controller remembers from line to line, and where the chain of segments ends.

    Words are kept as they were written, so that a word is left out exactly when the controller has it already.
    """

    job: str = ''
    # last accepted; None = the chain is open, any index above `done` may come
    index: int | None = None
    end: Point | None = None  # m, work; None = start from where the machine is
    arc: bool = False
    words: tuple[tuple[str, str], ...] = ()  # last written X Y Z F W S; empty = nothing is known


# segments (work frame) and work zero (m, machine coordinates) -> the same segments, none faster than the machine can
Pace = Callable[[Sequence[Segment], Point], list[Segment]]


def as_programmed(segments: Sequence[Segment], zero: Point) -> list[Segment]:
    """The `Pace` of a machine whose axes are those of the program."""
    return list(segments)


@dataclass(frozen=True)
class Permit:
    """What a batch is checked against, taken at one moment; void when the bridge's `generation` has moved on."""

    generation: int  # of the bridge when it was taken
    modal: Modal  # state of the controller's words
    # largest index accepted (chain closed) or executed (chain open), -1 = none; up to there segments are
    # duplicates
    known: int
    here: Point | None  # m, work frame, position of the machine; None while it moves
    offset: Point  # m, work zero in machine coordinates
    limits: Limits  # of the machine
    pace: Pace = as_programmed  # of the machine


@dataclass(frozen=True)
class Batch:
    """Segments that passed: their lines (G-code, mark or None) and the state after them."""

    lines: list[tuple[bytes, Mark | None]]
    after: Modal
    accepted: int
    duplicates: int


def number(value: float, digits: int) -> str:
    """Shortest decimal text with at most `digits` decimals, never '-0'."""
    text = f'{value:.{digits}f}'
    if digits:
        text = text.rstrip('0').rstrip('.')
    return '0' if text == '-0' else text


class Writer:
    """Writes segments as G-code lines; each modal word only when it changes."""

    def __init__(self, modal: Modal) -> None:
        self.words = dict(modal.words)
        self.arc = modal.arc
        self.lines: list[tuple[bytes, Mark | None]] = []

    def _emit(self, text: str, mark: Mark | None = None) -> None:
        self.lines.append((text.encode(), mark))

    def _changed(self, **words: str) -> str:
        """' X1 Y2' of those words that differ from what the controller knows."""
        out = ''
        for letter, text in words.items():
            if self.words.get(letter) != text:
                self.words[letter] = text
                out += f' {letter}{text}'
        return out

    def _source(self, s: Segment) -> str:
        """Wire and voltage words that changed; only while the arc is on."""
        if not s.arc:
            return ''
        return self._changed(W=number(to_mm_min(s.wire_feed_speed), 2), S=number(s.voltage, 3))

    def arc_end(self) -> None:
        """Arc off, then gas off (its post-flow is the controller's); nothing while the arc is off."""
        if self.arc:
            self._emit('M5')
            self._emit('M9')
            self.arc = False

    def _arc_start(self, s: Segment) -> None:
        self._emit('M7')
        self.words.pop('W', None)
        self.words.pop('S', None)
        self._emit('M3' + self._source(s))
        self.arc = True

    def segment(self, s: Segment, job: str) -> None:
        """The lines of one segment. Its mark, with which `segment_done` is found, is on the last of them."""
        mark = Mark(job, s.index, s.layer, s.bead)
        if units := self._changed(G='21 G90'):
            self._emit(units.strip())
        if self.arc and not s.arc:
            self.arc_end()
        if s.arc and not self.arc:
            self._arc_start(s)
        if s.kind == Kind.DWELL:
            self._emit(f'G4 P{number(s.dwell, 3)}' + self._source(s), mark)
            return
        x, y, z = (number(to_mm(v), 4) for v in s.end)
        move = self._changed(X=x, Y=y, Z=z) or f' X{x}'
        feed = self._changed(F=number(to_mm_min(s.speed), 2))
        self._emit('G1' + move + feed + self._source(s), mark)


def _between(s: Segment, name: str, value: float, limits: tuple[float, float], unit: str) -> None:
    low, high = limits
    if not low - SLACK <= value <= high + SLACK:
        raise Refusal(
            BAD_SEGMENT,
            f'segment {s.index}: {name} is {value:g} {unit}, limits {low:g} .. {high:g}',
        )


def _check_position(s: Segment, name: str, point: Point, offset: Point, limits: Limits) -> None:
    for axis, p, o, low, high in zip('xyz', point, offset, limits.low, limits.high, strict=True):
        if not low - SLACK <= p + o <= high + SLACK:
            raise Refusal(
                BAD_SEGMENT,
                f'segment {s.index}: {name}.{axis} is {to_mm(p + o):.3f} mm in machine coordinates, '
                f'limits {to_mm(low):g} .. {to_mm(high):g} mm',
            )


def check_segment(s: Segment, offset: Point, limits: Limits) -> None:
    """Raises Refusal BAD_SEGMENT, naming index, field and limit. `offset`: work zero in machine coordinates, m."""
    try:
        s.check()
    except SegmentError as e:
        raise Refusal(BAD_SEGMENT, str(e)) from None
    if s.tool_axis[2] < 1 - 1e-9:
        raise Refusal(
            BAD_SEGMENT, f'segment {s.index}: tool_axis is {s.tool_axis}, this machine cannot tilt'
        )
    _check_position(s, 'end', s.end, offset, limits)
    if s.kind == Kind.DWELL:
        _between(s, 'dwell', s.dwell, (0.0, LONGEST_DWELL), 's')
        if math.dist(s.start, s.end) > CHAIN_TOLERANCE:
            raise Refusal(BAD_SEGMENT, f'segment {s.index}: end differs from start in a dwell')
    else:
        speed = limits.arc_speed if s.arc else (0.0, limits.speed_max)
        _between(s, 'speed', s.speed, speed, 'm/s')
    if s.arc:
        _between(s, 'wire_feed_speed', s.wire_feed_speed, limits.wire_feed_speed, 'm/s')
        _between(s, 'voltage', s.voltage, limits.voltage, 'V')


def _check_joint(s: Segment, end: Point, before: str, tolerance: float) -> None:
    gap = math.dist(s.start, end)
    if not gap <= tolerance:
        raise Refusal(
            BAD_SEGMENT,
            f'segment {s.index}: start {s.start} is {to_mm(gap):.3f} mm from {before}',
        )


def _check_index(s: Segment, last: int | None) -> None:
    if last is not None and s.index != last + 1:
        raise Refusal(GAP, f'segment {s.index} does not follow segment {last}')


def prepare(permit: Permit, segments: list[Segment], last: bool) -> Batch:
    """Checks a batch and writes its lines; nothing changes anywhere else. `last`: end the arc afterwards.

    Raises Refusal; then no segment of the batch is to be taken.
    """
    modal = permit.modal
    new = permit.pace([s for s in segments if s.index > permit.known], permit.offset)
    index, end = modal.index, modal.end
    tolerance, before = CHAIN_TOLERANCE, f'the end of segment {index}'
    if new and end is None:
        if permit.here is None:
            raise Refusal(WRONG_STATE, 'the machine is moving: its position is not known yet')
        end, tolerance, before = permit.here, START_TOLERANCE, 'the position of the machine'
    writer = Writer(modal)
    for s in new:
        _check_index(s, index)
        check_segment(s, permit.offset, permit.limits)
        assert end is not None  # of the chain, or where the machine is
        _check_joint(s, end, before, tolerance)
        writer.segment(s, modal.job)
        index, end = s.index, s.end
        tolerance, before = CHAIN_TOLERANCE, f'the end of segment {index}'
    if last:
        writer.arc_end()
    words = tuple(writer.words.items())
    after = replace(modal, index=index, end=end if new else modal.end, arc=writer.arc, words=words)
    return Batch(writer.lines, after, len(new), len(segments) - len(new))
