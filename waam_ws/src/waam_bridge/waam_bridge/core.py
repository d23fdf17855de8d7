"""What the bridge knows and decides: jobs, commands, faults, lease. Pure: no ROS, no port, no clock.

The owner feeds it lines and time, writes what `poll` returns, and publishes what collects in `outbox`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from waam_process.segment import Point, Segment
from waam_process.units import mm

from . import frames, program, requests
from .frames import ALARM, HOLD, IDLE, STATE_NAMES
from .lease import Lease
from .link import Link
from .outbox import ALARM_SEVERITY, FAULT, INFO, WARNING, Notice, Outbox, ResendWatch, of_fault
from .params import BridgeParams
from .program import Mark, Modal, Permit, Refusal

Reply = Callable[[int, str], None]


class Bridge:
    """State of the machine as the host sees it, and everything that may be asked of it."""

    def __init__(self, params: BridgeParams) -> None:
        self.params = params
        self.link = Link(params, self._lease_us, self._on_ready)
        self.lease = Lease()
        self.outbox = Outbox(changed=True)
        self.state, self.fault, self.fault_text = IDLE, 0, ''
        self.message = 'not connected'
        self.armed_job = ''
        self.silent: list[str] = []
        self.offset: Point | None = None  # m, work zero in machine coordinates
        self.flags = 0
        self.modal = Modal()
        self.done = -1  # last executed index of modal.job
        self._generation = 0
        self._broken = ''  # why the program cannot go on
        self._drop_reason = (
            ''  # queue to be dropped once the next telemetry has told what was executed
        )
        self._armed_seen = False
        self._tick = 0
        self._after_frame: list[Callable[[], None]] = []
        self._after_limit = 0.0  # s
        self._home: tuple[int, Reply, float] | None = None
        self.overrides = (1.0, 1.0)  # speed, wire: factors that were asked for
        self._resends = ResendWatch(params.resend_warning)

    @property
    def connected(self) -> bool:
        return self.link.ready

    @property
    def job(self) -> str:
        return self.armed_job or self.modal.job

    @property
    def queued(self) -> int:
        """Segments that were not executed."""
        return self.link.sender.marks

    @property
    def running(self) -> Mark | None:
        """The oldest segment that was not executed."""
        return self.link.sender.oldest_mark

    @property
    def position(self) -> Point | None:
        """m, work frame."""
        t = self.link.telemetry
        return (t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6) if t else None

    def take_outbox(self) -> Outbox:
        box, self.outbox = self.outbox, Outbox()
        return box

    def notice(self, severity: int, class_name: str, text: str, reaction: str = 'none') -> None:
        self.outbox.notices.append(Notice(severity, class_name, text, reaction))

    # ---- the port

    def opened(self, now: float) -> None:
        self.link.opened(now)

    def closed(self, reason: str) -> None:
        """The port is closed or could not be opened."""
        if self.connected:
            self.notice(FAULT, 'link', f'link lost: {reason}', 'retry')
        self.link.closed(reason)
        self._end_home(requests.NOT_CONNECTED, reason)
        self._flush_after_frame()
        self.say(reason)

    def say(self, message: str) -> None:
        if message != self.message:
            self.message = message
            self.outbox.changed = True

    def _on_ready(self, known: bool, now: float) -> None:
        link = self.link
        self.outbox.changed = True
        self.lease.restart(link.boot)
        if known:
            self._take_done(link.executed)
            if not link.sender.pending:
                self.modal = replace(self.modal, words=())
            self.say('link restored')
            self.notice(INFO, 'link', 'link restored, same boot of the controller', 'retry')
            return
        if link.connects > 1:
            self.notice(
                ALARM_SEVERITY, 'link', 'the controller has restarted: its queue is lost', 'abort'
            )
        self._drop_reason = self._broken = ''
        self._reopen()
        self._start_offset()
        self.armed_job = ''
        self.lease.require(())
        self.overrides = (1.0, 1.0)
        if link.telemetry.flags & frames.ARMED:
            link.ask('D', '', lambda code, text: None, now)
        self.say('ready')

    def _start_offset(self) -> None:
        """The work zero of a controller that was just met."""
        who, t = self.link.identity, self.link.telemetry
        if who.offset_mm:
            self.offset = tuple(mm(v) for v in who.offset_mm)
        else:
            self.offset = None if t.flags & frames.HOMED else (0.0, 0.0, 0.0)

    # ---- lines and time

    def line(self, raw: bytes, now: float) -> frames.Telemetry | None:
        """Takes one line of the controller; returns it when it is telemetry that is to be published."""
        frame = self.link.line(raw, now)
        kind = type(frame)
        if kind is frames.Telemetry:
            if not self.connected:
                return None
            self._on_telemetry(frame)
            return frame
        if kind is frames.StateChange:
            self._set_state(frame.state, frame.code, frame.text)
        elif kind is frames.LineRefused:
            self._on_refused(frame)
        if self._home and self.link.sender.acked >= self._home[0]:
            self._end_home(requests.OK, 'homing')
        return None

    def _on_telemetry(self, t: frames.Telemetry) -> None:
        self._take_done(t.line_executed)
        if t.state != self.state or t.fault != self.fault:
            self._set_state(t.state, t.fault, '')
        if (t.flags ^ self.flags) & (frames.ARC_ENABLED | frames.HOMED | frames.ARMED):
            self._on_flags(t.flags)
        self.flags = t.flags
        if self._drop_reason and t.state in (IDLE, ALARM):
            self._drop(self._drop_reason)
        if t.t_us - self._tick >= self.params.tick_period * 1e6 or t.t_us < self._tick:
            self._on_tick(t)
        if self._after_frame and not self._drop_reason:
            self._flush_after_frame()

    def _take_done(self, line: int) -> None:
        for mark in self.link.sender.executed(line):
            self.done = mark.index
            self.outbox.done.append(mark)

    def _on_tick(self, t: frames.Telemetry) -> None:
        self._tick = self.outbox.tick_us = t.t_us
        silent = self.lease.silent(t.t_us) if self.armed_job else []
        if silent != self.silent:
            new = [n for n in silent if n not in self.silent]
            if new:
                severity = FAULT if t.flags & frames.ARC_ENABLED else WARNING
                text = f'no heartbeat from {", ".join(new)}: the arc lease is withheld'
                self.notice(severity, 'node', text, 'hold')
            self.silent = silent
            self.outbox.changed = True

    def _on_flags(self, flags: int) -> None:
        self.outbox.changed = True
        if flags & frames.ARMED:
            self._armed_seen = True
        elif self._armed_seen and self.armed_job:
            self._disarmed()

    def _disarmed(self) -> None:
        self.armed_job, self._armed_seen, self.silent = '', False, []
        self.lease.require(())
        self.outbox.changed = True

    def poll(self, now: float) -> bytes:
        """What is to be written now. Call it after every line and at least every 20 ms."""
        if self._home and now > self._home[2]:
            self._end_home(requests.TIMEOUT, 'the controller did not accept G28 within 1 s')
        if self._after_frame and now > self._after_limit:
            self._flush_after_frame()
        if self.connected and (notice := self._resends.poll(self.link.sender, now)):
            self.outbox.notices.append(notice)
        return self.link.poll(now)

    # ---- state and faults

    def _set_state(self, state: int, code: int, text: str) -> None:
        new = (state, code) != (self.state, self.fault)
        if not new and not (text and text != self.fault_text):
            return
        self.state, self.fault = state, code
        self.fault_text = (text or frames.CODES.get(code, '')) if code else ''
        self.outbox.changed = True
        if new and state in (HOLD, ALARM) and code:
            notice = of_fault(state, code, self.fault_text, self.silent)
            self.outbox.notices.append(notice)
            self.say(notice.text)
        if new and state == ALARM:
            self.link.sender.blocked = True
            self._drop_reason = f'ALARM E{code} {self.fault_text}'.rstrip()

    def _on_refused(self, refused: frames.LineRefused) -> None:
        sender = self.link.sender
        if sender.blocked:
            return
        text = f'E{refused.code} {refused.text or frames.CODES.get(refused.code, "")}'.rstrip()
        if self._home and refused.seq == self._home[0]:
            self._end_home(requests.REFUSED, f'controller: {text}')
            self._forget()
            return
        where = f'line {refused.seq} refused: {text} at column {refused.column}'
        self._broken = where
        lost = sender.drop(keep=refused.seq - 1)  # what the controller has is still executed
        self.link.resync()
        self._reopen()
        self.say(f'{where}; {lost} segments dropped')
        self.notice(FAULT, 'link', where, 'abort')

    def _drop(self, reason: str) -> None:
        """Forgets all segments that were not executed, and says why."""
        lost = self.queued
        self._forget()
        self.say(f'{reason}; {lost} segments dropped' if lost else reason)

    def _forget(self) -> None:
        self._drop_reason = ''
        self.link.sender.drop()
        self.link.resync()
        self._reopen()

    def _reopen(self) -> None:
        """The next segment starts from where the machine is, with all words written anew."""
        self.modal = Modal(job=self.modal.job)
        self._generation += 1

    # ---- lease

    def _lease_us(self, t_us: int) -> int:
        return self.lease.seen_us(t_us) if self.armed_job else 0

    def beat(self, node: str, tick_us: int, boot: int, now: float) -> None:
        """Heartbeat of a node. When it moves the lease of an armed job, the controller hears of it at once."""
        t = self.link.telemetry
        if t is None:
            return
        before = self.lease.seen_us(t.t_us)
        counts = self.lease.beat(node, tick_us, boot, t.t_us) and self.armed_job and self.connected
        if counts and self.lease.seen_us(t.t_us) > before:
            self.link.beat(now)

    # ---- segments

    def permit(self, job: str, segments: list[Segment]) -> Permit:
        """May these segments come now? Raises Refusal. The answer is used with `program.prepare` and `commit`."""
        if not self.connected:
            raise Refusal(program.NOT_CONNECTED, self.message)
        if not job:
            raise Refusal(program.BAD_SEGMENT, 'job_id is empty')
        if self._broken:
            raise Refusal(program.WRONG_STATE, f'{self._broken}; stop or arm first')
        if self.state in (HOLD, ALARM) or self._drop_reason:
            raise Refusal(
                program.WRONG_STATE, f'controller is in {STATE_NAMES[self.state]}: {self.message}'
            )
        if not self.flags & frames.HOMED:
            raise Refusal(program.WRONG_STATE, 'not homed: HOME first')
        if self.offset is None:
            raise Refusal(program.WRONG_STATE, 'the work zero is not known: SET_ZERO first')
        modal, known = self._chain(job)
        new = sum(s.index > known for s in segments)
        if any(s.arc for s in segments if s.index > known) and self.armed_job != job:
            raise Refusal(program.NOT_ARMED, f"armed for '{self.armed_job}', not for '{job}'")
        if self.queued + new > self.params.queue_size:
            text = (
                f'{self.queued} segments wait, {new} more do not fit into {self.params.queue_size}'
            )
            raise Refusal(program.QUEUE_FULL, text)
        limits = self.params.limits(self.link.identity.limits_mm)
        return Permit(self._generation, modal, known, self._here(), self.offset, limits)

    def _chain(self, job: str) -> tuple[Modal, int]:
        """State of the chain for this job, and the largest index that is known already."""
        if job == self.modal.job:
            index = self.modal.index
            return self.modal, self.done if index is None else index
        if self.queued:
            text = f"job '{self.modal.job}' still has {self.queued} segments"
            raise Refusal(program.WRONG_STATE, text)
        return Modal(job=job), -1

    def _here(self) -> Point | None:
        at_rest = self.state == IDLE and not self.queued and not self.link.sender.pending
        return self.position if at_rest else None

    def commit(self, permit: Permit, batch: program.Batch) -> None:
        """Puts the lines of a checked batch into the queue. Raises Refusal when the machine was stopped meanwhile."""
        if permit.generation != self._generation or not self.connected:
            raise Refusal(program.WRONG_STATE, f'interrupted: {self.message}')
        if batch.after.job != self.modal.job:
            self.done = -1
        self.modal = batch.after
        put = self.link.sender.put
        for gcode, mark in batch.lines:
            put(gcode, mark)

    # ---- commands: see commands.py

    def ask(
        self,
        letter: str,
        args: str,
        reply: Reply,
        now: float,
        then: Callable[[], None] = lambda: None,
        repeat: bool = True,
    ) -> None:
        """An immediate line whose outcome is the reply. OK is told after the next telemetry, which shows the effect;
        after a stop, once the machine stands."""

        def done(code: int, text: str) -> None:
            if code == requests.OK:
                then()
                self.outbox.changed = True
                self._after_frame.append(lambda: reply(code, text))
                self._after_limit = self.link.heard + requests.LIMIT
            else:
                self.outbox.replies.append(lambda: reply(code, text))

        self.link.ask(letter, args, done, now, repeat)

    def _flush_after_frame(self) -> None:
        self.outbox.replies += self._after_frame
        self._after_frame = []

    def home(self, reply: Reply, now: float) -> None:
        seq = self.link.sender.put(b'G28')
        self._reopen()
        self._home = (seq, reply, now + requests.LIMIT)

    def _end_home(self, code: int, text: str) -> None:
        if self._home:
            reply = self._home[1]
            self._home = None
            self.outbox.replies.append(lambda: reply(code, text))

    def stopped(self, reason: str) -> None:
        """The queue goes as soon as telemetry has told what was executed."""
        self.link.sender.blocked = True
        self._broken = ''
        self._drop_reason = reason

    def armed(self, job: str, names: list[str]) -> None:
        self.armed_job, self._armed_seen, self._broken = job, False, ''
        self.lease.require(names)
        self.outbox.changed = True

    def disarm(self) -> None:
        self._disarmed()

    def moved(self) -> None:
        """The machine moved, or its zero did, outside the program."""
        self._reopen()

    def set_offset(self, offset_mm: tuple[float, ...]) -> None:
        self.offset = tuple(mm(v) for v in offset_mm)
        self._reopen()
