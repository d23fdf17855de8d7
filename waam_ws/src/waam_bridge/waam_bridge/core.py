"""What the bridge knows and decides: jobs, commands, faults, lease. Pure: no ROS, no port, no clock.

The owner feeds it lines and time, writes what `poll` returns, and publishes what collects in `outbox`.
"""

from __future__ import annotations

from collections.abc import Callable

from waam_process.segment import Point, Segment
from waam_process.units import mm

from . import batches, faults, frames, overrides, program, requests
from .acceleration import Accelerometer
from .frames import ALARM, IDLE
from .gantry import Gantry
from .machine import Machine
from .outbox import ALARM_SEVERITY, FAULT, INFO, WARNING, ResendWatch
from .params import CommonParams
from .pending import Reply
from .program import Permit
from .standoff import Standoff
from .temperature import PartTemperature

TICK_S = 0.1  # between lease ticks, controller time: a lease is as old as one of them and the slowest answer


class Bridge(Machine):
    """The machine, and everything that may be asked of it."""

    def __init__(self, params: CommonParams) -> None:
        super().__init__(params, self._on_ready)
        # why there must be no arc for now: asked before a job is armed
        self.unfit: Callable[[], str] = lambda: ''
        self.standoff = Standoff(params)
        self.temperature = PartTemperature(params)
        self.gantry = Gantry(params)
        self.accelerometer = Accelerometer(params.accelerometer_axes)
        self._tick = 0
        self._resends = ResendWatch()

    # ---- the port

    def opened(self, now: float) -> None:
        """The port is open. now: s, steady clock."""
        self.link.opened(now)

    def closed(self, reason: str) -> None:
        """The port is closed or could not be opened."""
        if self.connected:
            self.notice(FAULT, 'link', f'link lost: {reason}', 'retry')
        self.link.closed(reason)
        self.pending.end_home(requests.NOT_CONNECTED, reason, self.outbox.replies)
        self.pending.flush(self.outbox.replies)
        self.say(reason)

    def _on_ready(self, known: bool, restarted: bool, now: float) -> None:
        link = self.link
        self.outbox.changed = True
        self.arming.restart(link.boot, known)
        if known:
            self._take_done(link.who.executed)
            self.say('link restored')
            self.notice(INFO, 'link', 'link restored, same boot of the controller', 'retry')
        else:
            self._meet(restarted, now)
        self._take_state(link.newest)  # an alarm at power-up is known from the first moment on

    def _meet(self, restarted: bool, now: float) -> None:
        """Handles a controller that is not the one before, or that has lost its queue."""
        link = self.link
        self.standoff.met(self)
        self.temperature.met(self)
        self.gantry.met(self)
        if link.connects > 1:
            who = (
                'the controller has restarted' if restarted else 'another host used the controller'
            )
            self.notice(ALARM_SEVERITY, 'link', f'{who}: its queue is lost', 'abort')
        self.dropping = self.broken = ''
        self.reopen()
        self._start_offset()
        self.overrides = self.process = (1.0, 1.0)
        if link.newest.flags & frames.ARMED:
            link.ask('D', '', lambda code, text: None, now)
        self.say('ready')

    def _start_offset(self) -> None:
        """The work zero of a controller that was just met."""
        told = self.link.who.offset_mm
        if told:
            self.offset = _point(told)
        else:
            self.offset = None if self.link.newest.flags & frames.HOMED else (0.0, 0.0, 0.0)

    # ---- lines and time

    def line(self, raw: bytes, now: float) -> frames.Telemetry | None:
        """Takes one line of the controller; returns it when it is telemetry that is to be published."""
        frame = self.link.line(raw, now)
        if isinstance(frame, frames.Telemetry):
            if not self.connected:
                return None
            self._on_telemetry(frame, now)
            return frame
        if isinstance(frame, frames.StateChange) and frame.code == frames.ACCELEROMETER:
            self.accelerometer.lost(self, f'E{frame.code} {frame.text}')
        elif isinstance(frame, frames.StateChange):
            faults.state_changed(self, frame.state, frame.code, frame.text)
        elif isinstance(frame, frames.LineRefused):
            faults.line_refused(self, frame)
        elif isinstance(frame, frames.Standoff) and self.connected and self.standoff.heard(frame):
            self.outbox.standoff.append(frame)
        elif isinstance(frame, frames.PartTemperature) and self.connected:
            if self.temperature.heard(frame, self):
                self.outbox.temperatures.append(frame)
        elif isinstance(frame, frames.Acceleration) and self.connected:
            self.accelerometer.heard(self, frame)
        if 0 < self.pending.home_line <= self.link.sender.acked:
            self.pending.end_home(requests.OK, 'homing', self.outbox.replies)
        return None

    def _on_telemetry(self, t: frames.Telemetry, now: float) -> None:
        self._take_done(t.line_executed)
        self._take_state(t)
        if self.link.missing:
            why, self.link.missing = self.link.missing, ''
            faults.lines_denied(self, why)
        if self.dropping and t.state in (IDLE, ALARM):
            self._drop(self.dropping)
        if t.t_us - self._tick >= TICK_S * 1e6 or t.t_us < self._tick:
            self._on_tick(t, now)
        self.standoff.poll(self, now)
        self.temperature.poll(self, now)
        self.gantry.poll(self, now)
        if not self.dropping:
            self.pending.flush(self.outbox.replies)

    def _take_state(self, t: frames.Telemetry) -> None:
        if t.state != self.state or t.fault != self.fault:
            faults.state_changed(self, t.state, t.fault, '')
        if (t.flags ^ self.flags) & (frames.ARC_ENABLED | frames.HOMED | frames.ARMED):
            self.outbox.changed = True
            self.arming.flags(t.flags)
        self.flags = t.flags

    def _take_done(self, line: int) -> None:
        for mark in self.link.sender.executed(line):
            self.done = mark.index
            self.outbox.done.append(mark)

    def _on_tick(self, t: frames.Telemetry, now: float) -> None:
        self._tick = self.outbox.tick_us = t.t_us
        new = self.arming.check(t.t_us, now)
        if new is None:
            return
        self.outbox.changed = True
        if new:
            severity = FAULT if t.flags & frames.ARC_ENABLED else WARNING
            twice = self.arming.twice(new, now)
            why = twice or f'no heartbeat from {", ".join(new)}'
            self.notice(severity, 'node', f'{why}: the arc lease is withheld', 'hold')
            if twice:
                self.say(twice)

    def poll(self, now: float) -> bytes:
        """What is to be written now. Call it after every line and at least every 20 ms."""
        self.pending.poll(now, self.outbox.replies)
        overrides.expire(self, now)
        self.accelerometer.poll(self, now)
        if self.connected and (notice := self._resends.poll(self.link.sender, now)):
            self.outbox.notices.append(notice)
        return self.link.poll(now)

    # ---- the queue

    def _drop(self, reason: str) -> None:
        """Forgets all segments that were not executed, and says why."""
        lost = self.queued
        self.forget()
        self.say(f'{reason}; {lost} segments dropped' if lost else reason)

    # ---- lease and segments

    def beat(self, node: str, tick_us: int, boot: int, now: float, source: str = '') -> None:
        """Heartbeat of a node, from this publisher. When it moves the lease of an armed job, the controller hears of it
        at once."""
        t = self.link.telemetry
        if t and self.arming.beat(node, tick_us, boot, t.t_us, now, source) and self.connected:
            self.link.beat(now)

    def permit(self, job: str, segments: list[Segment]) -> Permit:
        """Whether these segments are accepted now. Raises Refusal."""
        return batches.permit(self, job, segments)

    def commit(self, permit: Permit, batch: program.Batch) -> None:
        """Puts the lines of a checked batch into the queue. Raises Refusal."""
        batches.commit(self, permit, batch)

    # ---- commands: see commands.py

    def ask(
        self,
        letter: str,
        args: str,
        reply: Reply,
        now: float,
        then: Callable[[], None] = lambda: None,
    ) -> None:
        """An immediate line whose outcome is the reply. OK comes after the next telemetry, which shows the effect;
        after a stop, once the machine stands."""

        def done(code: int, text: str) -> None:
            if code == requests.OK:
                then()
                self.outbox.changed = True
                self.pending.after_frame(lambda: reply(code, text), self.link.heard)
            else:
                self.outbox.replies.append(lambda: reply(code, text))

        self.link.ask(letter, args, done, now)

    def home(self, reply: Reply, now: float) -> None:
        """Queues G28. The reply comes once the controller has accepted it, or with TIMEOUT after 1 s."""
        seq = self.link.sender.put(b'G28')
        self.reopen()
        self.pending.home(seq, reply, now)

    def stopped(self, reason: str) -> None:
        """Drops the queue as soon as telemetry has shown what was executed."""
        self.link.sender.blocked = True
        self.broken = ''
        self.dropping = reason

    def armed(self, job: str, names: list[str], now: float) -> None:
        """ARM was accepted: `job` may use the arc while the nodes `names` answer. now: s, steady clock."""
        if job != self.armed_job:
            overrides.begin_job(self, now)
        t = self.link.telemetry
        self.broken = ''
        self.arming.arm(job, names, t.t_us if t else 0, now)
        self.outbox.changed = True

    def disarm(self) -> None:
        """No job may use the arc any more."""
        self.arming.disarm()
        self.outbox.changed = True

    def set_offset(self, offset_mm: tuple[float, ...]) -> None:
        """The work zero in machine coordinates, mm; the next segment repeats all modal words."""
        self.offset = _point(offset_mm)
        self.reopen()


def _point(values_mm: tuple[float, ...]) -> Point:
    """x, y, z in m."""
    x, y, z = (mm(v) for v in values_mm)
    return x, y, z
