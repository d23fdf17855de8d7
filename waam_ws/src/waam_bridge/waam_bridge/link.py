"""One connection to the controller: identification, numbering, heartbeat, round trips, counters.

Pure: bytes to write collect in `out`, time is an argument (s, steady clock). ROS time at a steady time is
`now + ros_offset_ns`, which the owner keeps up to date.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import IntEnum

from . import frames, parsing
from .clock import ClockMap
from .params import CommonParams
from .requests import OK, Done, Requests
from .stream import Sender

IDENTITY = 'WAAM_CONTROLLER_V1'  # name that the controller must give
ASK_AGAIN = 0.5  # s
IDENTIFY_TIMEOUT = 2.0  # s: four questions
SILENCE_TIMEOUT = 3.0  # s without any line; a simulated cell may be silent for 2 s
HEARTBEAT_S = 0.05  # between heartbeats, controller time and wall time
RESEND_S = 0.2  # without progress for so long the oldest line is sent again
REPEAT_RESYNC = 0.05  # s between attempts to agree on the next number
PONGS = 400  # round trips kept for the percentiles
SEQUENCE = 2**32
MISSING_FRAMES = 3  # in a row that deny lines which were acknowledged
DEFAULT_RATE = 100.0  # Hz of telemetry after `$I`


class Phase(IntEnum):
    """Of a connection: port closed, asking who is there, agreeing on the next line number, in use."""

    CLOSED = 0
    IDENTIFY = 1
    SYNC = 2
    READY = 3


class Link:
    """lease_us(t_us): how far the arc lease may be renewed at controller time t_us, 0 = none.
    on_ready(known, restarted, now): the controller may be used; `known` when it is the same one, with the same boot
    and lines, `restarted` when it has booted since.

    `failed` holds the reason when the owner shall close the port; `missing`, when the controller denies lines that it
    has acknowledged.
    """

    def __init__(
        self,
        params: CommonParams,
        lease_us: Callable[[int], int],
        on_ready: Callable[[bool, bool, float], None],
    ) -> None:
        self.params, self._lease_us, self._on_ready = params, lease_us, on_ready
        self.sender = Sender(RESEND_S, params.window)
        self.requests = Requests()
        self.clock = ClockMap()
        self.phase = Phase.CLOSED
        self.failed = self.missing = ''
        self.out: list[bytes] = []
        self.identity: frames.Identity | None = None
        self.telemetry: frames.Telemetry | None = None
        self.ros_offset_ns = 0
        self.bad_frames = self.received = self.lost = self.connects = 0
        self.round_trips: deque[float] = deque(maxlen=PONGS)
        self.heard = 0.0  # s, last good line
        self._since = self._asked = 0.0
        self._attempts = 0
        self._boot: int | None = None  # of the controller that the sender's numbers belong to
        self._resync = False  # the controller must be told the next line number
        self._token = 0
        self._pings: dict[int, float | None] = {}  # when each was written, None = not yet
        self._beat = 0.0  # s
        self._beat_us = 0
        self._denials = 0

    @property
    def ready(self) -> bool:
        """The controller may be used."""
        return self.phase == Phase.READY

    @property
    def boot(self) -> int:
        """Number of the controller's boot, 0 while nothing has identified itself."""
        return self.identity.boot if self.identity else 0

    @property
    def who(self) -> frames.Identity:
        """What the controller said of itself; only from phase SYNC on."""
        assert self.identity is not None
        return self.identity

    @property
    def newest(self) -> frames.Telemetry:
        """The last telemetry; only in phase READY."""
        assert self.telemetry is not None
        return self.telemetry

    def reaches(self, limits_mm: tuple[float, ...]) -> None:
        """The controller was told another envelope: x0, y0, z0, x1, y1, z1, mm."""
        self.identity = self.who._replace(limits_mm=limits_mm)

    # ---- the port

    def opened(self, now: float) -> None:
        """The port is open; asks for the identity first. now: s, steady clock."""
        self.phase, self.failed, self.missing = Phase.IDENTIFY, '', ''
        self._since = self.heard = now
        self._asked, self._attempts = now - ASK_AGAIN, 0
        self._pings.clear()
        self.out.clear()

    def closed(self, reason: str) -> None:
        """The port is closed: queued lines are kept, requests that wait are answered with `reason`."""
        self.phase = Phase.CLOSED
        self.sender.blocked = True
        self._resync = False
        self.out.clear()
        self.requests.fail(reason)

    # ---- from the controller

    def line(self, raw: bytes, now: float) -> frames.Frame | None:
        """Takes one line that was read at `now`; returns what it said, None when it must not be acted on."""
        try:
            frame = parsing.parse(raw)
        except frames.FrameError:
            self.bad_frames += 1
            return None
        self.heard = now
        if isinstance(frame, frames.Telemetry):
            self._on_telemetry(frame, now)
        elif isinstance(frame, frames.Ack):
            self.sender.ack(frame.seq, frame.blocks, frame.room, now)
        elif isinstance(frame, frames.Resend):
            self.sender.resend(frame.expected, now)
        elif isinstance(frame, frames.Pong):
            self._on_pong(frame, now)
        elif isinstance(frame, frames.Answer):
            self.requests.answer(frame)
        elif isinstance(frame, frames.Identity):
            self._on_identity(frame, now)
        return frame

    def _on_telemetry(self, t: frames.Telemetry, now: float) -> None:
        if self.phase < Phase.SYNC:
            return
        self._count(t)
        self.telemetry = t
        if self.phase == Phase.SYNC:
            if not self.requests.waits('L'):
                self._synchronise(t, now)
        else:
            self._check_promise(t)
            self.sender.ack(t.line_accepted, t.free_blocks, None, now)
        if t.t_us - self._beat_us >= HEARTBEAT_S * 1e6:
            self.beat(now)

    def _count(self, t: frames.Telemetry) -> None:
        before = self.telemetry
        self.received += 1
        if before is not None:
            gap = (t.seq - before.seq) % SEQUENCE - 1
            if 0 < gap < SEQUENCE // 2:
                self.lost += gap

    def _check_promise(self, t: frames.Telemetry) -> None:
        """What was acknowledged must be there. Only a damaged answer that passed its check can break this."""
        denied = not self.sender.blocked and t.line_accepted < self.sender.acked
        self._denials = self._denials + 1 if denied else 0
        if self._denials == MISSING_FRAMES:
            self.missing = (
                f'the controller has lines up to {t.line_accepted}, '
                f'but up to {self.sender.acked} were acknowledged'
            )

    def _on_pong(self, pong: frames.Pong, now: float) -> None:
        sent = self._pings.pop(pong.token, None)
        if sent is None:
            return
        self.round_trips.append(now - sent)
        if not self.clock.synchronised:
            offset = self.ros_offset_ns
            self.clock.add(round(sent * 1e9) + offset, round(now * 1e9) + offset, pong.t_us)

    def _on_identity(self, who: frames.Identity, now: float) -> None:
        if self.phase != Phase.IDENTIFY:
            return
        if who.name != IDENTITY:
            self.failed = f"identifies itself as '{who.name}', expected '{IDENTITY}'"
            return
        if self._boot != who.boot or who.synchronised != self.clock.synchronised:
            self.clock.reset(who.synchronised)
            self.telemetry = None
        self.identity = who
        self.sender.digits = self.requests.digits = who.digits
        self.phase, self._since = Phase.SYNC, now
        self._beat_us = 0
        self.beat(now)

    def _synchronise(self, t: frames.Telemetry, now: float) -> None:
        """Tells the controller which line comes next. What it had taken before the link broke is not sent again."""
        sender, accepted = self.sender, self.who.accepted
        known = self._boot == self.boot and sender.acked <= accepted <= sender.written

        def done(code: int, text: str) -> None:
            if code != OK:
                self.failed = f'line numbers could not be agreed: {text}'
                return
            if not known:
                sender.restart()
            sender.resync(accepted + 1, t.free_blocks, self.who.rx, self.heard)
            restarted = self._boot != self.boot
            self._boot, self.phase = self.boot, Phase.READY
            self.connects += 1
            if self.params.telemetry_rate != DEFAULT_RATE:
                self._ask_rate(self.heard)
            self._on_ready(known, restarted, self.heard)

        self.ask('L', str(accepted + 1), done, now)

    def _ask_rate(self, now: float) -> None:
        def done(code: int, text: str) -> None:
            if code != OK and self.ready:
                self.failed = f'the telemetry rate was not taken: {text}'

        self.ask('T', f'{self.params.telemetry_rate:g}', done, now)

    # ---- to the controller

    def ask(self, letter: str, args: str, done: Done, now: float) -> None:
        """Sends an immediate line; `done(code, text)` is called once. Raises FrameError, see `frames.immediate`."""
        self.out.append(self.requests.ask(letter, args, done, now))

    def resync(self) -> None:
        """After lines were dropped: agree on the next number before anything else is sent."""
        self.sender.blocked = self._resync = True

    def _ask_resync(self, now: float) -> None:
        first = self.sender.acked + 1
        self._asked = now

        def done(code: int, text: str) -> None:
            if code == OK and first == self.sender.acked + 1 and self.telemetry and self.ready:
                self.sender.resync(first, self.telemetry.free_blocks, self.who.rx, self.heard)
                self._resync = False

        self.ask('L', str(first), done, now)

    def beat(self, now: float) -> None:
        """A heartbeat; renews the link watchdog and, as far as the nodes have come, the arc lease."""
        t_us = self.telemetry.t_us if self.telemetry else 0
        self._token = (self._token + 1) % SEQUENCE
        if len(self._pings) > PONGS:
            self._pings.clear()
        self._pings[self._token] = None
        self.out.append(frames.heartbeat(self._token, self._lease_us(t_us), self.sender.digits))
        self._beat, self._beat_us = now, t_us

    def wrote(self, now: float) -> None:
        """What `poll` returned last was handed to the port at `now`: round trips count from here."""
        for token in reversed(self._pings):
            if self._pings[token] is not None:
                return
            self._pings[token] = now

    def poll(self, now: float) -> bytes:
        """To be called after every line and at least every 20 ms: what is to be written now."""
        if self.phase == Phase.READY:
            self._poll_ready(now)
        elif self.phase == Phase.IDENTIFY:
            self._poll_identify(now)
        if self.phase >= Phase.SYNC:
            if now - self._beat >= HEARTBEAT_S:
                self.beat(now)
            again = self.requests.poll(now)
            if again:
                self.out.append(again)
            if now - self.heard > SILENCE_TIMEOUT:
                self.failed = f'the controller is silent for {SILENCE_TIMEOUT:g} s'
        if not self.out:
            return b''
        data = b''.join(self.out)
        self.out.clear()
        return data

    def _poll_ready(self, now: float) -> None:
        if self._resync and not self.requests.waits('L') and now - self._asked > REPEAT_RESYNC:
            self._ask_resync(now)
        lines = self.sender.poll(now)
        if lines:
            self.out.append(lines)

    def _poll_identify(self, now: float) -> None:
        """Asks with the strong check first; a controller that does not know it understands the other one."""
        if now - self._since > IDENTIFY_TIMEOUT:
            text = f'no valid answer to $I within {IDENTIFY_TIMEOUT:g} s: not a {IDENTITY}'
            self.failed = text
        elif now - self._asked >= ASK_AGAIN:
            self._asked = now
            digits = frames.CRC16 if self._attempts % 2 else frames.CRC32
            self._attempts += 1
            self.out.append(b'\n' + frames.immediate('I', 'keep', 0, digits))
