"""Starts the built virtual controller and talks to it over its pseudo-terminal."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
import threading
import time
import tty
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # helpers beside the tests

from plant_cell import Cell  # noqa: E402

TELEMETRY_FIELDS = [
    'seq', 't_us', 'state', 'flags', 'x_um', 'y_um', 'z_um', 'v_um_s', 'wire_cmd_um_s', 'wire_um_s', 'current_mA',
    'voltage_mV', 'line_accepted', 'line_executed', 'free_blocks', 'speed_permille', 'wire_permille', 'lease_left_ms',
    'underruns', 'fault',
]  # fmt: skip
IDLE, RUN, HOLD, ALARM = range(4)
ARC, ESTABLISHED, GAS, HOMED, ARMED, EMPTY, ESTOP, WIRE_JOG = (1 << i for i in range(8))


def executable() -> Path:
    """The installed controller: found by ROS where it is sourced, else in the workspace's install folder.

    WAAM_VIRTUAL_CONTROLLER names another build, for example one with sanitizers.
    """
    if other := os.environ.get('WAAM_VIRTUAL_CONTROLLER'):
        return Path(other)
    try:
        from ament_index_python.packages import get_package_prefix

        path = Path(get_package_prefix('waam_firmware')) / 'lib/waam_firmware/virtual_controller'
        if path.exists():
            return path
    except (ImportError, LookupError):
        pass
    return Path(__file__).parents[3] / 'install/waam_firmware/lib/waam_firmware/virtual_controller'


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE, bit by bit: another form than the one under test."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc


def seal(text: str) -> bytes:
    data = text.encode()
    return data + b'*%05d\n' % crc16(data)


class Client:
    """A host: reads everything, answers every telemetry frame with a heartbeat, streams within the window."""

    def __init__(self, path: str, heartbeat: bool = True) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        self.lines: list[str] = []  # all but telemetry and heartbeats
        self.stamps: list[int] = []  # controller time of the frame before each of them, us
        self.frames: list[dict[str, int]] = []
        self.bad_checks = 0
        self.stamped = 0  # us, controller time of the last answer
        self.heartbeat = heartbeat
        # give the frame's time as lease; 'frozen': give frozen_lease
        self.lease: bool | str = False
        self.frozen_lease = 0
        self.paused = False  # do not read
        self.sequence = 0
        self.accepted = 0
        self._changed = threading.Condition()
        self._closing = False
        self._write_lock = threading.Lock()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closing = True
        self._thread.join()
        os.close(self.fd)

    def raw(self, data: bytes) -> None:
        with self._write_lock:
            while data:
                data = data[os.write(self.fd, data) :]

    def text(self, text: str) -> None:
        self.raw(seal(text))

    @staticmethod
    def sealed(text: str) -> bytes:
        return seal(text)

    def numbered(self, number: int, gcode: str) -> None:
        self.text(f'N{number} {gcode}')

    def _read(self) -> None:
        rest = b''
        while not self._closing:
            if self.paused or not select.select([self.fd], [], [], 0.02)[0]:
                time.sleep(0.005 if self.paused else 0)
                continue
            try:
                rest += os.read(self.fd, 65536)
            except OSError:
                return
            *complete, rest = rest.split(b'\n')
            with self._changed:
                for line in complete:
                    self._line(line)
                self._changed.notify_all()

    def _line(self, line: bytes) -> None:
        content, _, check = line.rpartition(b'*')
        right = zlib.crc32(content) if len(check) == 10 else crc16(content)
        if not check.isdigit() or len(check) not in (5, 10) or int(check) != right:
            self.bad_checks += 1
            return
        text, _, stamp = content.decode().partition(' @')
        self.stamped = int(stamp or 0) or self.stamped
        if text.startswith('T '):
            self._telemetry(text)
        elif not text.startswith('$H ') or ' error ' in text:
            self.lines.append(text)
            self.stamps.append(self.frame.get('t_us', 0))
            if match := re.match(r'ok N(\d+)', text):
                self.accepted = max(self.accepted, int(match[1]))

    def _telemetry(self, text: str) -> None:
        values = [int(v) for v in text[2:].split(',')]
        assert len(values) == len(TELEMETRY_FIELDS)
        frame = dict(zip(TELEMETRY_FIELDS, values, strict=True))
        self.frames.append(frame)
        if self.heartbeat:
            self.text(f'$H {frame["seq"]} {self._lease(frame)}')

    def _lease(self, frame: dict[str, int]) -> int:
        return self.frozen_lease if self.lease == 'frozen' else frame['t_us'] if self.lease else 0

    def wait(self, condition: Callable[[], object], timeout: float = 10.0) -> object:
        """The first true value of `condition`; fails after `timeout` seconds of wall time."""
        end = time.monotonic() + timeout
        with self._changed:
            while not (value := condition()):
                left = end - time.monotonic()
                if left <= 0:
                    pytest.fail(f'timed out; last lines {self.lines[-8:]}, frame {self.frame}')
                self._changed.wait(min(left, 0.2))
            return value

    @property
    def frame(self) -> dict[str, int]:
        return self.frames[-1] if self.frames else {}

    def next_frame(self) -> dict[str, int]:
        count = len(self.frames)
        self.wait(lambda: len(self.frames) > count + 1)
        return self.frame

    def wait_line(self, pattern: str, start: int = 0, timeout: float = 10.0) -> str:
        return str(
            self.wait(
                lambda: next((x for x in self.lines[start:] if re.search(pattern, x)), None),
                timeout,
            )
        )

    def ask(self, text: str) -> str:
        """Sends an immediate line and returns its answer."""
        start = len(self.lines)
        self.raw(seal(text))
        return self.wait_line(r'^\$[' + text[1] + '?]', start)

    def send(self, *gcodes: str) -> int:
        """Sends numbered lines within a window of 1500 bytes; returns the last number."""
        flying: list[tuple[int, int]] = []
        for gcode in gcodes:
            self.sequence += 1
            data = seal(f'N{self.sequence} {gcode}')
            while sum(n for _, n in flying) + len(data) > 1500:
                flying = [(s, n) for s, n in flying if s > self.accepted]
                if sum(n for _, n in flying) + len(data) > 1500:
                    before = self.accepted
                    self.wait(lambda before=before: self.accepted > before)
            self.raw(data)
            flying.append((self.sequence, len(data)))
        return self.sequence

    def run(self, *gcodes: str, timeout: float = 20.0) -> None:
        """Streams lines and waits until all are executed and the machine is idle."""
        last = self.send(*gcodes)
        self.wait(
            lambda: (
                self.frame and self.frame['line_executed'] == last and self.frame['state'] == IDLE
            ),
            timeout,
        )

    def identify(self) -> str:
        return self.ask('$I')

    def home(self) -> None:
        self.identify()
        self.sequence = self.accepted = 0
        self.run('G28')
        assert self.frame['flags'] & HOMED

    def ready_for_arc(self) -> None:
        self.home()
        self.lease = True
        assert self.ask('$A test') == '$A ok'

    def weld(self, length: float = 150.0) -> None:
        """Homes, strikes the arc and starts one long move of 10 mm/s."""
        self.ready_for_arc()
        self.send('G0 X50 Y50 Z100', 'M3 W5000 S22', f'G1 X{50 + length} F600')
        self.wait(lambda: self.frame['flags'] & ESTABLISHED and self.frame['v_um_s'] > 0)


class Controller:
    """One virtual controller process; `idle`: acknowledged already, not in the ALARM of a power-up."""

    def __init__(self, folder: Path, *arguments: str, idle: bool = True) -> None:
        self.link = folder / 'tty'
        self.event_file = folder / 'events'
        self.process = subprocess.Popen(
            [
                str(executable()),
                '--pty-link',
                str(self.link),
                '--events',
                str(self.event_file),
                *(['--start-idle'] if idle else []),
                *arguments,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        ready = self.process.stdout.readline()
        if not ready.startswith('ready '):
            assert self.process.stderr is not None
            raise RuntimeError(self.process.stderr.read())
        self.clients: list[Client] = []

    def connect(self, heartbeat: bool = True) -> Client:
        client = Client(str(self.link), heartbeat)
        self.clients.append(client)
        return client

    def events(self) -> list[tuple[int, str]]:
        """(controller time in us, what)."""
        rows = (line.split(' ', 1) for line in self.event_file.read_text().splitlines())
        return [(int(t), what) for t, what in rows]

    def time_of(self, what: str, after: int = 0) -> int:
        """Controller time, us, of the first event that starts with `what` after a time."""
        return next(t for t, event in self.events() if event.startswith(what) and t > after)

    def run_time(self, after: int) -> float:
        """Seconds in RUN of the first run that starts after a time."""
        begin = self.time_of('state RUN', after)
        return (self.time_of('state IDLE', begin) - begin) * 1e-6

    def close(self) -> None:
        if self.process.stdout and self.process.stdout.closed:
            return
        for client in self.clients:
            client.close()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            code = self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        errors = self.process.stderr.read() if self.process.stderr else ''
        for stream in (self.process.stdout, self.process.stderr):
            if stream:
                stream.close()
        assert code == 0, errors


@pytest.fixture(scope='session')
def client_class() -> type[Client]:
    """For hosts of other terminals than the virtual controller's."""
    return Client


@pytest.fixture(scope='session')
def controller_path() -> Path:
    return executable()


@pytest.fixture
def gcode_path() -> str:
    """The tool that prints the path of a program, beside the controller."""
    return str(executable().with_name('gcode_path'))


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Controller]]:
    """Starts controllers with the given arguments; each must end cleanly on SIGTERM."""
    started: list[Controller] = []

    def begin(*arguments: str, idle: bool = True) -> Controller:
        folder = tmp_path / str(len(started))
        folder.mkdir()
        started.append(Controller(folder, *arguments, idle=idle))
        return started[-1]

    yield begin
    for controller in started:
        controller.close()


@pytest.fixture
def controller(start: Callable[..., Controller]) -> Controller:
    """Inert plant, time at most 40 times as fast as real time."""
    return start('--null-plant', '--rate', '30', '--start', '8,6,195')


@pytest.fixture
def client(controller: Controller) -> Client:
    return controller.connect()


@pytest.fixture
def port(
    start: Callable[..., Controller], tmp_path: Path
) -> Iterator[tuple[Controller, Cell, Client]]:
    """A controller with a cell attached, and its client."""
    path = tmp_path / 'cell.sock'
    controller = start('--plant', str(path), '--rate', '30', '--start', '8,6,195')
    with closing(Cell(path)) as cell:
        yield controller, cell, controller.connect()
