"""The noise campaign: the whole bridge core streams beads to the real controller core over a bad cable that is pulled
out again and again, from a host that stalls. After every step there are two permitted outcomes:

- the executed sequence is a beginning of the one that was sent, and it goes on; or
- the controller is in HOLD or ALARM, the arc is off (or is being ended), and a code says why.

Anything else is a third outcome and is reported in words. An operator who resumes, or stops and sends the rest, is part
of the campaign: it goes on until every segment was executed exactly once.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from bridge_cable import Cable
from controller_lib import ControllerLib

from waam_bridge import commands, frames, program
from waam_bridge.commands import Command
from waam_bridge.core import Bridge
from waam_bridge.frames import ALARM, HOLD, HOMED, IDLE, RUN
from waam_bridge.params import BridgeParams
from waam_process.segment import Kind, Segment

STEP = 0.01  # s of both clocks per round
STEPS_PER_MM = 320
BATCH, AHEAD = 200, 400  # segments per enqueue; in the queue
BEAD = 1500  # segments between two arc starts
STUCK = 30.0  # s without a segment done, with nothing to say why
ARC_END = 0.6  # s that ending an arc may take, crater fill included
MEAN_PULL, MEAN_STALL = 25.0, 40.0  # s between pulled cables and host stalls
LONGEST_PULL, LONGEST_STALL = 3.0, 5.0  # s
NODE = 'worker'
JOB = 'noise'
# of the controller, as `$C` takes them: 2HUMP_EI and MZV
SHAPER = ('shape_x_hz 25', 'shape_y_hz 40', 'shape_x 5', 'shape_y 3')
SCALE = ('steps_per_mm_x 319.873', 'steps_per_mm_y 345.021', 'steps_per_mm_z 640.5')
ACCEL = ('max_accel_x 333.3', 'max_accel_y 450')


@dataclass
class Report:
    """What happened. `third` lists third outcomes; empty = passed."""

    segments: int = 0
    seconds: float = 0.0
    pulls: int = 0
    stalls: int = 0
    reconnects: int = 0
    resends: int = 0
    bad_frames: int = 0
    holds: dict[int, int] = field(default_factory=dict)
    stops: int = 0
    faults: dict[str, int] = field(default_factory=dict)
    bytes: int = 0
    arc_off_max_ms: float = 0.0
    third: list[str] = field(default_factory=list)


class Path:
    """Endless zigzag of short segments; the same `seed` gives the same ones. Positions in m, on whole steps."""

    def __init__(self, seed: int) -> None:
        self._dice = random.Random(seed)
        self._at = (0.05, 0.05, 0.05)

    def start(self) -> tuple[float, float, float]:
        return self._at

    def segment(self, index: int) -> Segment:
        """A segment of 0.05 to 0.2 mm; every BEAD-th ones are without arc."""
        before, (x, y, z) = self._at, self._at
        x += self._dice.choice((-1, 1)) * self._dice.randrange(16, 64) / STEPS_PER_MM * 1e-3
        y += self._dice.choice((-1, 1)) * self._dice.randrange(16, 64) / STEPS_PER_MM * 1e-3
        x, y = (min(0.2, max(0.001, v)) for v in (x, y))
        if abs(x - before[0]) < 1e-5:  # at the edge
            x += 16 / STEPS_PER_MM * 1e-3 * (1 if x < 0.1 else -1)
        self._at = (x, y, z)
        arc = index % BEAD >= 20
        source = (
            {'wire_feed_speed': self._dice.choice((0.07, 0.08)), 'voltage': 22.0} if arc else {}
        )
        kind = Kind.DEPOSIT if arc else Kind.IDLE
        return Segment(
            index=index, kind=kind, start=before, end=self._at, speed=0.05, arc=arc, **source
        )


def scale_of(settings: Iterable[str]) -> tuple[float, ...]:
    """Steps per mm of x, y, z with these settings."""
    told = dict(s.split() for s in settings)
    return tuple(float(told.get(f'steps_per_mm_{axis}', STEPS_PER_MM)) for axis in 'xyz')


def steps(segment: Segment, scale: Sequence[float] = 3 * (STEPS_PER_MM,)) -> tuple[int, ...]:
    """Where the controller must stand after it: what the line says, rounded as the controller rounds."""
    return tuple(
        math.floor(round(v * 1e3, 4) * k + 0.5) for v, k in zip(segment.end, scale, strict=True)
    )


class Campaign:
    """`rate`: probability per byte, each way, of each fault. `rough`: cables are pulled and the host stalls. `settings`
    of the controller, as `$C` takes them."""

    def __init__(
        self,
        segments: int,
        seed: int = 1,
        rate: float = 1e-4,
        rough: bool = True,
        settings: Iterable[str] = (),
    ) -> None:
        self.total, self.rough = segments, rough
        self.dice = random.Random(seed)
        self.controller = ControllerLib(boot=seed)
        settings = tuple(settings)
        self.scale = scale_of(settings)
        for setting in settings:
            self.controller.feed(frames.immediate('C', setting, 0, frames.CRC16))
            assert b'$C ok' in (answer := self.controller.take()), answer
        self.up, self.down = Cable(self.dice, 0.0), Cable(self.dice, 0.0, 1 << 17)
        self.bridge = Bridge(BridgeParams(arc_speed_max=0.1))
        self.path = Path(seed)
        self.now = 1000.0
        self.report = Report()
        self.waiting: deque[Segment] = deque()  # not executed, in order
        self.made = 0
        self._open_at, self._open = self.now, False
        self._rest = b''
        self._stalled_until = 0.0
        self._reported = 0  # segments that the bridge has reported
        self._progress = self.now
        self._stopped_at = 0.0  # s, since when the controller is not in RUN; 0 = it is
        self._operator_at = 0.0
        self._held = False
        self._prepare()
        for cable in (self.up, self.down):
            cable.set_rate(rate)
        self._next_pull, self._next_stall = self._later(MEAN_PULL), self._later(MEAN_STALL)

    def _later(self, mean: float) -> float:
        return self.now + self.dice.expovariate(1 / mean)

    def _third(self, text: str) -> None:
        self.report.third.append(f't={self.now - 1000:.2f} s: {text}')

    # ---- time, cable, host

    def round(self) -> None:
        """One step of everything."""
        self.now += STEP
        self.controller.feed(self.up.receive())
        self.controller.run(round(STEP * 1e3))
        self.down.send(self.controller.take())
        if self.now >= self._stalled_until:
            self._host()

    def _host(self) -> None:
        bridge, link = self.bridge, self.bridge.link
        if not self._open:
            if self.now < self._open_at:
                return
            self._open, self._rest = True, b''
            self.down.cut()  # a port is flushed when it is opened
            bridge.opened(self.now)
        *lines, self._rest = (self._rest + self.down.receive()).split(b'\n')
        for line in lines:
            bridge.line(line, self.now)
            self._collect()
        data = bridge.poll(self.now)
        link.wrote(self.now)
        self._collect()
        self.up.send(data)
        if link.failed:
            self._close(link.failed, 0.5)

    def _collect(self) -> None:
        box = self.bridge.take_outbox()
        for mark in box.done:
            if mark.job_id == JOB:
                if mark.index != self._reported:
                    self._third(f'segment {mark.index} reported after {self._reported - 1}')
                self._reported = mark.index + 1
        for reply in box.replies:
            reply()
        if box.tick_us is not None:
            self.bridge.beat(NODE, box.tick_us, self.bridge.link.boot, self.now)

    def _close(self, reason: str, pause: float) -> None:
        self.bridge.closed(reason)
        self._collect()
        self.up.cut()
        self._open, self._open_at = False, self.now + pause
        self.report.reconnects += 1

    def _accidents(self) -> None:
        if self.now >= self._next_pull:
            self._next_pull = self._later(MEAN_PULL)
            self.report.pulls += 1
            self.controller.hang_up()
            if self._open:
                self._close('pulled', self.dice.uniform(0.02, LONGEST_PULL))
        if self.now >= self._next_stall:
            self._next_stall = self._later(MEAN_STALL)
            self.report.stalls += 1
            self._stalled_until = self.now + self.dice.uniform(0.02, LONGEST_STALL)

    # ---- what is permitted

    def _check(self) -> None:
        for move in self.controller.moves():
            s = self.waiting.popleft() if self.waiting else None
            if s is None or move.end != steps(s, self.scale):
                self._third(
                    f'line {move.line} ended at {move.end}, not {s and steps(s, self.scale)}'
                )
                return
            if s.arc and abs(move.wire_mm_s - s.wire_feed_speed * 1e3) > 1e-3:
                self._third(f'segment {s.index}: wire {move.wire_mm_s} mm/s')
            self.report.segments += 1
            self._progress = self.now
        view = self.controller.look()
        self._stopped_at = 0.0 if view.state == RUN else self._stopped_at or self.now
        if view.arc and self._stopped_at and self.now - self._stopped_at > ARC_END:
            self._third(f'the arc is on in state {view.state}')
        if view.state in (HOLD, ALARM) and not view.fault:
            self._third('HOLD or ALARM without a reason')
        if view.state == HOLD and not self._held:
            holds = self.report.holds
            holds[view.fault] = holds.get(view.fault, 0) + 1
        self._held = view.state == HOLD
        if view.arc_off_us and view.fault in (201, 202):
            late = (view.arc_off_us - view.arc_off_lease_us) * 1e-3
            self.report.arc_off_max_ms = max(self.report.arc_off_max_ms, late)
        if view.state == ALARM or self.now - self._progress > STUCK:
            self._third(f'stuck: state {view.state}, fault {view.fault}: {self.bridge.message}')

    # ---- the job and its operator

    def _command(self, code: int, *args, **kwargs) -> None:
        """Starts a command; over such a cable it may fail, and is given again a little later."""
        command = Command(code, *args, **kwargs)
        commands.run(self.bridge, command, lambda code, text: None, self.now)

    def _until(self, condition, limit: float) -> None:
        end = self.now + limit
        while not condition():
            assert self.now < end, f'not reached: {self.bridge.message}'
            self.round()

    def _prepare(self) -> None:
        """Over a good cable: homed, armed, at the start."""
        bridge = self.bridge
        self._until(lambda: bridge.connected and bridge.position, 10.0)
        self._command(commands.HOME)
        self._until(lambda: bridge.flags & HOMED and bridge.state == IDLE, 120.0)
        start = self.path.start()
        way = Segment(index=0, kind=Kind.IDLE, start=bridge.position, end=start, speed=0.4)
        self._enqueue([way], 'approach', True)
        self._until(lambda: bridge.state == IDLE and not bridge.queued, 60.0)
        self._command(commands.ARM, JOB, (NODE,))
        self._until(lambda: bridge.armed_job == JOB, 5.0)
        self.controller.moves()
        self._progress = self.now

    def _enqueue(self, segments: list[Segment], job: str, last: bool) -> None:
        with contextlib.suppress(program.Refusal):
            permit = self.bridge.permit(job, segments)
            self.bridge.commit(permit, program.prepare(permit, segments, last))

    def _feed(self) -> None:
        """Keeps the queue of the bridge filled."""
        bridge = self.bridge
        if not bridge.connected or bridge.queued > AHEAD - BATCH:
            return
        while len(self.waiting) < 2 * AHEAD and self.made < self.total:
            self.waiting.append(self.path.segment(self.made))
            self.made += 1
        index = -1 if bridge.modal.job != JOB else bridge.modal.index
        first = (bridge.done if index is None else index) + 1
        batch = [s for s in self.waiting if s.index >= first][:BATCH]
        if not batch:
            return
        if bridge.modal.end is None and bridge.position:  # after a stop: the rest of a segment
            batch[0] = batch[0].at(start=bridge.position)
        self._enqueue(batch, JOB, batch[-1].index == self.total - 1)

    def _operator(self) -> None:
        """Resumes what is held; stops what is broken, so that the rest can be sent again."""
        bridge = self.bridge
        if not bridge.connected or self.now < self._operator_at:
            return
        if bridge.broken:
            self.report.stops += 1
            self._command(commands.STOP)
        elif bridge.state == HOLD and not self.controller.look().arc:
            self._command(commands.RESUME)
        else:
            return
        self._operator_at = self.now + 1.5

    def run(self, on_progress: Callable[[int], None] = lambda done: None) -> Report:
        """Until every segment is executed, or a third outcome."""
        begin = self.now
        while self.report.segments < self.total and not self.report.third:
            self._feed()
            self._operator()
            self.round()
            if self.rough:
                self._accidents()
            self._check()
            on_progress(self.report.segments)
        self._finish()
        self.report.seconds = self.now - begin
        return self.report

    def _finish(self) -> None:
        """Nothing moves after the last segment, and the bridge has reported every one."""
        report, sender = self.report, self.bridge.link.sender
        for cable in (self.up, self.down):
            cable.set_rate(0.0)
        end = self.now + 20.0
        while self._reported < self.total and self.now < end and not report.third:
            self._operator()
            self.round()
        if not report.third and (self._reported != self.total or self.controller.moves()):
            self._third(f'the bridge has reported {self._reported} of {self.total} segments')
        report.resends, report.bad_frames = sender.resends, self.bridge.link.bad_frames
        report.bytes = self.up.bytes + self.down.bytes
        report.faults = {k: self.up.faults[k] + self.down.faults[k] for k in self.up.faults}
        self.controller.close()
