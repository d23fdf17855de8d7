"""A small controller for tests, written from docs/link_protocol.md alone: it shares no code with the bridge.

`FakeCore` is bytes in, bytes out, and a step of 10 ms; `FakeController` runs it in a thread behind a pseudo-terminal.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import threading
import time
import tty
import zlib

IDLE, RUN, HOLD, ALARM = range(4)
NAMES = ['IDLE', 'RUN', 'HOLD', 'ALARM']


def crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ (0x1021 if value & 0x8000 else 0)) & 0xFFFF
    return value


def sealed(text: str, strong: bool = False) -> bytes:
    """With a CRC-32 in ten digits when `strong`, else with a CRC-16 in five."""
    data = text.encode()
    return data + (b'*%010d\n' % zlib.crc32(data) if strong else b'*%05d\n' % crc(data))


class FakeCore:
    """Executes up to `lines_per_step` queued lines in a step of 10 ms. `gcode` lists what was executed."""

    def __init__(self, boot: int = 7, blocks: int = 16, rx: int = 2048, sync: bool = True) -> None:
        self.boot, self.blocks, self.rx, self.sync = boot, blocks, rx, sync
        self.t_us = 1_000_000
        self.lines_per_step = 1
        self.state, self.fault = IDLE, 0
        self.armed = self.arc = self.stuck = False
        self.homed = self.tells_offset = True
        self.lease_us = 0
        self.position = [0, 0, 0]  # um
        self.offset_mm = [0.0, 0.0, 0.0]
        self.speed = self.wire = 1000
        self.received = self.executed = self.frame = 0
        self.queue: list[str] = []
        self.blocked = False
        self.gcode: list[str] = []
        self.seen: list[str] = []  # immediate lines other than heartbeats, without their tokens
        self.done: dict[str, str] = {}  # token -> answer
        self.rate = 100
        self.strong = False  # seal with a CRC-32, as the last `$I` was
        self.checks: set[int] = set()  # digits of the checks that came
        self.beats: list[tuple[int, int]] = []  # (t_us, lease_us)
        self.refuse: dict[str, str] = {}  # letter -> 'E108 not now'
        self.mute: set[str] = set()  # letters that get no answer
        self.refuse_line = ''  # queued lines with this text are wrong
        self.name = 'WAAM_CONTROLLER_V1'
        self._rest = b''
        self._out: list[bytes] = []

    def say(self, text: str) -> None:
        stamp = '' if text[0] in 'TD' or text.startswith('$H') else f' @{self.t_us}'
        self._out.append(sealed(text + stamp, self.strong))

    def take(self) -> bytes:
        data, self._out = b''.join(self._out), []
        return data

    def feed(self, data: bytes) -> None:
        for byte, act in ((b'\x82', self.stop), (b'\x80', self.hold)):
            if byte * 2 in data:
                act()
            data = data.replace(byte, b'')
        *lines, self._rest = (self._rest + data).split(b'\n')
        for line in filter(None, lines):
            self._line(line)

    def _line(self, line: bytes) -> None:
        text, star, check = line.rpartition(b'*')
        good = zlib.crc32(text) if len(check) == 10 else crc(text)
        if not star or not check.isdigit() or int(check) != good or not text.isascii():
            self.resend(100)
        elif text.startswith(b'$'):
            self.checks.add(len(check))
            self._immediate(text.decode(), len(check))
        else:
            self.checks.add(len(check))
            self._queued(text.decode())

    def resend(self, code: int) -> None:
        if not self.blocked:
            self.say(f'rs N{self.received + 1} E{code}')

    def _queued(self, text: str) -> None:
        match = re.fullmatch(r'N(\d+) (.*)', text)
        if self.blocked:
            return
        seq = int(match[1])
        if seq > self.received + 1:
            self.resend(101)
            return
        if seq == self.received + 1:
            assert len(self.queue) < self.blocks, 'the host overran the window'
            if self.refuse_line and self.refuse_line in match[2]:
                self.blocked = True
                self.say(f'er N{seq} E103 C4 unknown word')
                return
            self.received = seq
            self.queue.append(match[2])
            if self.state == IDLE:
                self.go(RUN)
        self.say(f'ok N{self.received} P{self.free} B{self.rx}')

    @property
    def free(self) -> int:
        return self.blocks - len(self.queue)

    @property
    def offset_word(self) -> str:
        return 'off={:g},{:g},{:g} '.format(*self.offset_mm) if self.tells_offset else ''

    def go(self, state: int, code: int = 0, text: str = '') -> None:
        self.state, self.fault = state, code
        self.say(f'! {NAMES[state]} E{code} {text}'.rstrip())

    def stop(self) -> None:
        """Nothing more is accepted until `$L`."""
        self.queue.clear()
        self.arc, self.blocked = False, True
        if self.state in (RUN, HOLD):
            self.go(IDLE)

    def hold(self) -> None:
        if self.state == RUN:
            self.go(HOLD, 200, 'hold by host')

    def alarm(self, code: int, text: str) -> None:
        self.queue.clear()
        self.arc = self.armed = False
        self.blocked = True
        self.go(ALARM, code, text)

    def _immediate(self, text: str, digits: int) -> None:
        match = re.fullmatch(r'\$(\w)(?:@(\d+))?(?: (.*))?', text)
        letter, token, args = match[1], match[2], (match[3] or '').split()
        if letter == 'H':
            self.lease_us = int(args[1])
            self.beats.append((self.t_us, self.lease_us))
            if 'H' not in self.mute:
                self.say(f'$H {args[0]} {self.t_us}')
            return
        self.seen.append(f'${letter} {match[3] or ""}'.rstrip())
        if letter in self.mute:
            return
        if letter == 'I':
            self.strong = digits == 10
            self.done.clear()
            self._do_I(args)
            return
        name = f'${letter}' + (f'@{token}' if token else '')
        if token not in self.done:
            self.done[token] = self._do(letter, args)
        self.say(f'{name} {self.done[token]}')

    def _do(self, letter: str, args: list[str]) -> str:
        if letter in self.refuse:
            return f'error {self.refuse[letter]}'
        getattr(self, f'_do_{letter}', lambda args: None)(args)
        return 'ok'

    def _do_I(self, args) -> None:
        if args == ['keep']:
            self.blocked = True
        elif self.state == IDLE:
            self.received = self.executed = 0
            self.queue.clear()
            self.blocked = False
        clock = 'sync' if self.sync else 'free'
        self.say(
            f'$I {self.name} fw=0.0.1 boot={self.boot} clk={clock} blocks={self.blocks} '
            f'rx={self.rx} lim=0,0,0,400,300,200 spmm=320 {self.offset_word}acc={self.received} '
            f'exe={self.executed} cap=ARC,GAS'
        )

    def _do_A(self, args) -> None:
        self.armed = True

    def _do_D(self, args) -> None:
        self.armed = False

    def _do_L(self, args) -> None:
        assert int(args[0]) > self.received, 'a number that was used already'
        self.received, self.blocked = int(args[0]) - 1, False

    def _do_T(self, args) -> None:
        self.rate = int(args[0])

    def _do_S(self, args) -> None:
        self.stop()

    def _do_P(self, args) -> None:
        self.hold()

    def _do_R(self, args) -> None:
        self.go(RUN)

    def _do_X(self, args) -> None:
        self.homed = False
        self.go(IDLE)

    def _do_V(self, args) -> None:
        self.speed, self.wire = int(args[0]), int(args[1])

    def _do_J(self, args) -> None:
        for i in range(3):
            self.position[i] += round(float(args[i]) * 1000)

    def _do_Z(self, args) -> None:
        for i in range(3):
            new = float(args[i])
            self.position[i] += round((self.offset_mm[i] - new) * 1000)
            self.offset_mm[i] = new

    def step(self) -> None:
        self.t_us += 10_000
        if self.state == RUN and not self.stuck:
            for _ in range(self.lines_per_step):
                if self.queue:
                    self._execute(self.queue.pop(0))
            if not self.queue:
                self.go(IDLE)
        self._telemetry()

    def _execute(self, line: str) -> None:
        self.gcode.append(line)
        self.executed = self.received - len(self.queue)
        words = re.findall(r'([A-Z])([-\d.]+)', line)
        if ('M', '3') in words:
            self.arc = True
        if ('M', '5') in words:
            self.arc = False
        if ('G', '28') in words:
            self.homed = True
            self.position = [-round(o * 1000) for o in self.offset_mm]
        if ('G', '1') in words:
            for letter, value in words:
                if letter in 'XYZ':
                    self.position['XYZ'.index(letter)] = round(float(value) * 1000)

    def _telemetry(self) -> None:
        self.frame += 1
        flags = self.arc * 3 + self.homed * 8 + self.armed * 16 + (not self.queue) * 32
        x, y, z = self.position
        self.say(
            f'T {self.frame},{self.t_us},{self.state},{flags},{x},{y},{z},0,0,0,0,0,{self.received},'
            f'{self.executed},{self.free},{self.speed},{self.wire},0,0,{self.fault}'
        )


class FakeController:
    """A FakeCore behind a pseudo-terminal. `core` may be changed under `lock`; `path` is stable over `replug`."""

    def __init__(self, path, core: FakeCore | None = None, period: float = 0.01) -> None:
        self.path, self.period = str(path), period
        self.core = core or FakeCore()
        self.lock = threading.Lock()
        self.silent = False
        self._stop = threading.Event()
        self._plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _plug(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        self._slave = slave
        if os.path.islink(self.path):
            os.unlink(self.path)
        os.symlink(os.ttyname(slave), self.path)

    def unplug(self) -> None:
        """The port disappears; the core goes on."""
        with self.lock:
            os.unlink(self.path)
            os.close(self._slave)
            os.close(self._master)
            self._master = -1

    def replug(self) -> None:
        with self.lock:
            self._plug()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            fds = [self._master] if self._master >= 0 else []
            readable = select.select(fds, [], [], max(0, due - time.monotonic()))[0]
            with self.lock:
                if self._master >= 0 and readable:
                    self._read()
                if time.monotonic() >= due:
                    due += self.period
                    self.core.step()
                self._write()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            self.core.feed(os.read(self._master, 65536))

    def _write(self) -> None:
        data = self.core.take()
        if data and not self.silent and self._master >= 0:
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def close(self) -> None:
        self._stop.set()
        self._thread.join(2)
        for fd in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(fd)
