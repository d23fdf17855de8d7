"""Kills the host, kills the controller, pulls the terminal, each in the middle of a bead: when is the arc off?

The controller's own event log is the judge: `arc off` must come within 500 ms of controller time of the lease that was
in force, and a lease is never younger than the last sign of life.
"""

from __future__ import annotations

import contextlib
import os
import random
import select
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterable
from pathlib import Path

KINDS = ('host', 'terminal', 'controller')
LEASE_US = 500_000
PATIENCE = 60.0  # s
HERE = Path(__file__).parent


class Proxy:
    """A terminal of its own in front of the controller's, so that the cable between the two can be pulled."""

    def __init__(self, inner: Path, outer: Path) -> None:
        self.inner, self.outer = inner, outer
        self._fds: list[int] = []
        self._stop = threading.Event()
        self.plug()
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def plug(self) -> None:
        inner = os.open(self.inner, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        master, slave = os.openpty()
        tty.setraw(slave)
        tty.setraw(inner)
        os.set_blocking(master, False)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self.outer)
        os.symlink(os.ttyname(slave), self.outer)
        self._fds = [inner, master, slave]

    def pull(self) -> None:
        fds, self._fds = self._fds, []
        os.unlink(self.outer)
        time.sleep(0.005)
        for fd in fds:
            os.close(fd)

    def _pump(self) -> None:
        while not self._stop.is_set():
            fds = self._fds[:2]
            if not fds:
                time.sleep(0.001)
                continue
            with contextlib.suppress(OSError, ValueError):
                for fd in select.select(fds, [], [], 0.001)[0]:
                    os.write(fds[1 - fds.index(fd)], os.read(fd, 4096))

    def close(self) -> None:
        self._stop.set()
        self._thread.join(2)
        for fd in self._fds:
            os.close(fd)


class Scene:
    """Controller, cable and host; `strike` welds, and each way of killing returns the worst lease age in ms."""

    def __init__(
        self,
        folder: Path,
        controller: Path,
        seed: int = 1,
        rate: float = 8.0,
        settings: Iterable[str] = (),
    ) -> None:
        self.settings = [s.replace(' ', '=') for s in settings]
        self.folder, self.program, self.rate = folder, controller, rate
        self.dice = random.Random(seed)
        self.runs = 0
        self.controller = self.host = self.proxy = None
        self.start_controller()
        self.proxy = Proxy(folder / 'tty', folder / 'cable')
        self.start_host()

    def start_controller(self) -> None:
        self.runs += 1
        self.events_file = self.folder / f'events{self.runs}'
        options = ['--null-plant', '--rate', str(self.rate), '--start', '2,2,198']
        files = ['--pty-link', str(self.folder / 'tty'), '--events', str(self.events_file)]
        self.controller = subprocess.Popen(
            [str(self.program), *options, *files], stdout=subprocess.PIPE, text=True
        )
        assert self.controller.stdout.readline().startswith('ready')

    def start_host(self) -> None:
        self.host = subprocess.Popen(
            [
                sys.executable,
                str(HERE / 'bridge_light.py'),
                str(self.folder / 'cable'),
                *self.settings,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._heard = [b'']  # lines, and the beginning of the next

    def events(self) -> list[tuple[int, str]]:
        text = self.events_file.read_text()
        rows = (line.split(' ', 1) for line in text[: text.rfind('\n') + 1].splitlines())
        return [(int(t), what) for t, what in rows]

    def count(self, what: str) -> int:
        return sum(event.startswith(what) for _, event in self.events())

    def strike(self) -> None:
        """A bead that burns; then a random moment in it. Again when a stalled computer has lost the arc meanwhile."""
        while True:
            self.host.stdin.write(b'weld\n')
            self.host.stdin.flush()
            self.hear('welding')
            time.sleep(self.dice.uniform(0.0, 0.4))
            if self.count('arc on') > self.count('arc off'):
                return

    def hear(self, word: str) -> None:
        """Reads lines of the host until this one."""
        end = time.monotonic() + PATIENCE
        while word.encode() not in self._heard[:-1]:
            left = max(0.0, end - time.monotonic())
            ready = select.select([self.host.stdout], [], [], left)[0]
            assert ready, f'the host does not say {word} within {PATIENCE:.0f} s'
            data = os.read(self.host.stdout.fileno(), 4096)
            assert data, 'the host has died'
            self._heard = (self._heard.pop() + data).split(b'\n')
        del self._heard[: self._heard.index(word.encode()) + 1]

    def until(self, condition, what: str) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f'{what}: not reached; {self.events()[-5:]}'
            time.sleep(0.005)

    def arc_off_age_ms(self, before: int) -> float:
        """Waits for `arc off` number before + 1; how old the lease was then, by controller time."""
        self.until(lambda: self.count('lease') > 2 * before + 1, 'arc off')
        rows = self.events()
        at = [i for i, (_, event) in enumerate(rows) if event == 'arc off'][before]
        off_us = rows[at][0]
        lease_us = next(int(e.split()[1]) for _, e in rows[at:] if e.startswith('lease'))
        return (off_us - lease_us) * 1e-3

    def kill_host(self) -> float:
        before = self.count('arc off')
        self.host.kill()
        age = self.arc_off_age_ms(before)
        self.reap(self.host)
        self.start_host()
        return age

    def kill_terminal(self) -> float:
        before = self.count('arc off')
        self.proxy.pull()
        age = self.arc_off_age_ms(before)
        self.proxy.plug()
        self.hear('connected')
        return age

    def kill_controller(self) -> float:
        """Its outputs die with it (on the board: reset state of the pins). The next one must not strike by itself."""
        self.controller.kill()
        self.reap(self.controller)
        self.proxy.pull()
        self.start_controller()
        self.proxy.plug()
        self.hear('restarted')
        self.until(lambda: self.frames_later(), 'telemetry of the new controller')
        assert self.count('arc on') == 0, 'the new controller has struck an arc'
        return 0.0

    def frames_later(self) -> bool:
        """The host has had time to do something wrong: it welds only when it is told to."""
        time.sleep(0.3)
        return True

    @staticmethod
    def reap(process: subprocess.Popen) -> None:
        process.wait(10)
        for stream in (process.stdin, process.stdout):
            if stream:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()

    def kill(self, kind: str) -> float:
        self.strike()
        return {
            'host': self.kill_host,
            'terminal': self.kill_terminal,
            'controller': self.kill_controller,
        }[kind]()

    def close(self) -> None:
        for process in (self.host, self.controller):
            process.kill()
            self.reap(process)
        self.proxy.close()
