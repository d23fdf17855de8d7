"""A simulated cell whose STOP is measured, from the request to what its controller has received."""

from __future__ import annotations

import copy
import os
import re
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

from .live_graph import LiveGraph
from .stop_loads import QUIET

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
PATIENCE_S = 10.0  # a STOP that has not come by then counts as so late
UP_S = 90.0
NODES = ('dashboard',)  # that are left out


class StopCell:
    """machine: gantry or robot. A context manager; everything that it has started and mounted is gone afterwards."""

    def __init__(self, machine: str) -> None:
        self.machine = machine
        self.root = os.geteuid() == 0

    def __enter__(self) -> StopCell:
        from waam_bringup.operate import free_port
        from waam_node.testing import fresh_domain

        self._temporary = tempfile.TemporaryDirectory(prefix='waam_stop_')
        self.folder = Path(self._temporary.name)
        self.run, self.jobs = self.folder / 'run', self.folder / 'jobs'
        self.stamps = self.folder / 'stamps'
        for folder in (self.run, self.jobs):
            folder.mkdir()
        self._mounted = self.root and self._mount()
        self._kept = dict(os.environ)
        self.domain, self.page, self.second = fresh_domain(), free_port(), free_port()
        own = {'WAAM_JOBS': self.jobs, 'WAAM_RUN': self.run, 'STOP_STAMPS': self.stamps}
        os.environ |= {name: str(path) for name, path in own.items()}
        self.shop = self.jobs / '.shop' / 'cells' / 'cell'
        self._tap = self._client = self._live = None
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _mount(self) -> bool:
        words = ['mount', '-t', 'tmpfs', '-o', 'size=64m', 'none', str(self.jobs)]
        return subprocess.run(words, capture_output=True).returncode == 0

    @property
    def disks(self) -> bool:
        """Whether disks can be filled and made read-only."""
        return self._mounted

    def _start(self) -> None:
        from waam_bringup.client import GraphClient
        from waam_bringup.graph import Settings, load

        description, commands = copy.deepcopy(load()), {}
        if self.machine == 'gantry':
            real, link = self.run / 'controller.real', self.run / 'controller'
            words = description['virtual_controller']['arguments']
            words[words.index('${run}/controller')] = str(real)
            tap = [sys.executable, HERE / 'stop_tap.py', real, link, self.stamps]
            self._tap = subprocess.Popen(tap)
        else:
            commands['bridge'] = (sys.executable, str(HERE / 'stop_robot_bridge.py'))
        settings = Settings(
            run=self.run, rate=1.0, panel_port=self.page, stop_port=self.second, hang_timeout=0.0,
            without=NODES, machine=self.machine,
        )  # fmt: skip
        self._live = LiveGraph(settings, self.domain, UP_S, description, commands)
        self._live.start()
        self.pid = self._live.pid
        self._client = GraphClient(self.domain)
        self._live.ready(self._client)
        self._prepare()

    def _prepare(self) -> None:
        """The machine stands at home, ready; the client knows the bridge; the page has been loaded."""
        from waam_msgs.srv import Command

        client = self._client
        for code in (Command.Request.RESET, Command.Request.HOME):
            client.call(Command, 'bridge/command', Command.Request(code=code))
        self._service = client.node.create_client(Command, 'bridge/command')
        client.until(self._service.service_is_ready, 20.0)
        end = time.monotonic() + 30
        while True:
            try:
                with urllib.request.urlopen(f'http://127.0.0.1:{self.page}/', timeout=5) as page:
                    self.csrf = re.search(r'name="csrf" content="(\w+)"', page.read().decode())[1]
                    break
            except OSError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.2)
        client.until(lambda: False, 3.0)

    def __exit__(self, *_: object) -> None:
        if self._client:
            self._client.__exit__()
        if self._live:
            self._live.stop()
        if self._tap:
            self._tap.kill()
            self._tap.wait()
        if self._mounted:
            subprocess.run(['umount', '-l', str(self.jobs)], capture_output=True)
        os.environ.clear()
        os.environ |= self._kept
        self._temporary.cleanup()

    # ---- the ways; each returns ms from the request to the controller

    def panel(self) -> float:
        """As the page does: both ways at once."""
        began = time.monotonic_ns()
        with Asked((self.page, self.second), self.page, self.csrf) as asked:
            return self._arrives(began, asked.turn)

    def command(self) -> float:
        """`waam job abort`, from its start."""
        words = [str(ROOT / 'waam'), 'job', 'abort', '--run', str(self.run)]
        began = time.monotonic_ns()
        process = subprocess.Popen(words, start_new_session=True, **QUIET)
        try:
            return self._arrives(began, lambda: None)
        finally:  # the rest of it takes seconds, and says what the job did
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def service(self) -> float:
        """The service of the bridge, by a client that knows it already."""
        from waam_msgs.srv import Command

        began = time.monotonic_ns()
        future = self._service.call_async(Command.Request(code=Command.Request.STOP))
        found = self._arrives(began, lambda: None)
        self._client.until(future.done, 3.0)
        return found

    def _arrives(self, began: int, turn) -> float:
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            turn()
            with suppress(OSError):
                for line in self.stamps.read_text().split()[-8:]:
                    if int(line) > began:
                        return (int(line) - began) * 1e-6
            time.sleep(0.002)
        return PATIENCE_S * 1e3


class Asked:
    """POST /api/stop at several ports of this machine, none of which may hold up another one."""

    def __init__(self, ports: tuple[int, ...], page: int, csrf: str) -> None:
        self._selector, self._sent = selectors.DefaultSelector(), []
        for port in ports:
            site = 'same-origin' if port == page else 'same-site'
            own = f'X-Waam-Csrf: {csrf}\r\n' if port == page else ''
            text = (
                f'POST /api/stop HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{page}\r\n'
                f'Sec-Fetch-Site: {site}\r\n{own}Content-Length: 0\r\n\r\n'
            )
            s = socket.socket()
            s.setblocking(False)
            s.connect_ex(('127.0.0.1', port))
            self._selector.register(s, selectors.EVENT_WRITE, text.encode())
        self.turn()

    def turn(self) -> None:
        for key, _ in self._selector.select(0.0):
            with suppress(OSError):
                key.fileobj.send(key.data)
            self._selector.unregister(key.fileobj)
            self._sent.append(key.fileobj)

    def __enter__(self) -> Asked:
        return self

    def __exit__(self, *_: object) -> None:
        for key in list(self._selector.get_map().values()):
            self._sent.append(key.fileobj)
        self._selector.close()
        for s in self._sent:
            s.close()
