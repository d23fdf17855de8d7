"""A host process to be killed: the bridge's core and transport without ROS, so that it starts in a moment.

`python bridge_light.py PORT [NAME=VALUE ...]` welds as soon as the line 'weld' comes on stdin: stop, reset, home, the
settings (`$C`), arm, and a bead that is long enough. It prints 'connected', 'restarted' (another boot of the
controller) and 'welding'.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable

from waam_bridge import commands, frames, program
from waam_bridge.commands import Command
from waam_bridge.core import Bridge
from waam_bridge.params import BridgeParams
from waam_bridge.transport import SerialTransport
from waam_process.segment import Kind, Segment

SEGMENTS = 4000
PATIENCE = 120.0  # s that anything may take on a busy computer


class Light:
    """Owner of the transport."""

    def __init__(self, port: str, quiet: bool = False, **params) -> None:
        self.bridge = Bridge(BridgeParams(reconnect_period=0.05, **params))
        self.quiet = quiet
        self.settings: list[tuple[str, float]] = []
        self.lock = threading.RLock()
        self.job = 0
        self.on_frame: Callable[[frames.Telemetry], None] = lambda frame: None
        self.ros_offset_ns = time.time_ns() - time.monotonic_ns()
        self.transport = SerialTransport(port, 115200, self, 0.05)
        self.transport.start()

    def on_open(self) -> None:
        with self.lock:
            self.bridge.opened(time.monotonic())

    def on_close(self, reason: str) -> None:
        with self.lock:
            self.bridge.closed(reason)
            self._collect()

    def on_crash(self, error: Exception) -> None:
        raise SystemExit(str(error))

    def on_lines(self, lines: list[bytes], read_at: float) -> None:
        with self.lock:
            was = self.bridge.connected
            for line in lines:
                frame = self.bridge.line(line, read_at)
                if frame is not None:
                    self.on_frame(frame)
                self._collect()
            if self.bridge.connected and not was:
                self.say('connected')

    def on_idle(self) -> None:
        with self.lock:
            self.bridge.link.ros_offset_ns = self.ros_offset_ns
            data = self.bridge.poll(time.monotonic())
            self._collect()
            if data:
                self.transport.write(data)
                self.bridge.link.wrote(time.monotonic())
            if self.bridge.link.failed:
                self.transport.reopen(self.bridge.link.failed)

    def say(self, word: str) -> None:
        if not self.quiet:
            print(word, flush=True)

    def _collect(self) -> None:
        box = self.bridge.take_outbox()
        for notice in box.notices:
            if 'restarted' in notice.text:
                self.say('restarted')
        for reply in box.replies:
            reply()

    def command(self, code: int, *args) -> None:
        got: list[tuple[int, str]] = []
        with self.lock:
            commands.run(
                self.bridge, Command(code, *args), lambda *r: got.append(r), time.monotonic()
            )
        self.until(lambda: got)

    def configure(self, name: str, value: float) -> None:
        """One setting; the machine stands."""
        got: list[tuple[int, str]] = []
        with self.lock:
            command = Command(commands.CONFIGURE, name, value=value)
            commands.run(self.bridge, command, lambda *r: got.append(r), time.monotonic())
        self.until(lambda: got)
        if got[0][0]:
            raise SystemExit(f'{name}: {got[0][1]}')

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(f'nothing within {PATIENCE:.0f} s: {self.bridge.message}')
            time.sleep(0.002)

    def weld(self) -> None:
        bridge = self.bridge
        self.until(lambda: bridge.connected and bridge.position)
        self.command(commands.STOP)
        if bridge.state == frames.ALARM:
            self.command(commands.RESET)
        self.until(lambda: bridge.state == frames.IDLE)
        for name, value in self.settings:
            self.configure(name, value)
        if self.settings:
            time.sleep(0.2)  # steps per mm lose homing, which telemetry says later
        if not bridge.flags & frames.HOMED:
            self.command(commands.HOME)
        self.until(lambda: bridge.flags & frames.HOMED and bridge.state == frames.IDLE)
        self.job += 1
        job = f'job{self.job}'
        self.command(commands.ARM, job)
        x, y, z = bridge.position
        ends = [(x, y, z), (x + 1e-3, y, z)]
        source = {'wire_feed_speed': 0.08, 'voltage': 22.0, 'kind': Kind.DEPOSIT, 'arc': True}
        bead = [
            Segment(index=i, start=ends[i % 2], end=ends[(i + 1) % 2], speed=0.01, **source)
            for i in range(SEGMENTS)
        ]
        with self.lock:
            permit = bridge.permit(job, bead)
            bridge.commit(permit, program.prepare(permit, bead, True))
        stopped = (frames.HOLD, frames.ALARM)
        self.until(lambda: bridge.flags & frames.ARC_ESTABLISHED or bridge.state in stopped)
        if bridge.state in stopped:  # a busy computer let the lease run out before the arc burned
            self.weld()
        else:
            self.say('welding')


if __name__ == '__main__':
    light = Light(sys.argv[1])
    pairs = (a.split('=') for a in sys.argv[2:])
    light.settings = [(name, float(value)) for name, value in pairs]
    for word in sys.stdin:
        if word.strip() == 'weld':
            light.weld()
