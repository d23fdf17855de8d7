"""For tests: real processes in a ROS domain of their own, and a node to talk to them."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from .testing import fresh_domain


class Graph:
    """make: the test's own node; a bare one when there is none."""

    def __init__(self, make: Callable[[Context], Any] | None = None) -> None:
        self.domain, self.context = fresh_domain(), Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node: Any = make(self.context) if make else Node('test_client', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._started: list[tuple[subprocess.Popen[str], Any]] = []  # and what they say
        self._known: set[str] = set()

    def start(self, package: str, executable: str, *ros_args: str) -> subprocess.Popen[str]:
        """An executable of a package; `close` ends it."""
        path = Path(get_package_prefix(package)) / 'lib' / package / executable
        command = [str(path), *(['--ros-args', *ros_args] if ros_args else [])]
        own = {'ROS_DOMAIN_ID': str(self.domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        said = tempfile.TemporaryFile('w+')  # noqa: SIM115 - `close` does
        process = subprocess.Popen(
            command, env=os.environ | own, stdout=said, stderr=subprocess.STDOUT, text=True
        )
        self._started.append((process, said))
        return process

    def said(self) -> str:
        """What the processes have said so far."""
        texts = []
        for _, file in self._started:
            file.seek(0)
            texts.append(file.read())
        return '\n'.join(texts)

    def reached(self, condition: Callable[[], Any], timeout: float) -> bool:
        """Whether a condition holds within `timeout` s; the node spins meanwhile."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.02)
        return True

    def wait(
        self, condition: Callable[[], Any], timeout: float = 90.0, what: str = 'condition'
    ) -> None:
        """AssertionError with what the processes said when it is not reached."""
        assert self.reached(condition, timeout), f'{what}: not within {timeout} s; {self.said()}'

    def settle(self, seconds: float = 0.5) -> None:
        """A server that has not yet found the reader of a new client loses its first answer."""
        self.reached(lambda: False, seconds)

    def call(self, client: Any, request: Any, timeout: float = 60.0) -> Any:
        """The answer of a service."""
        self.wait(client.service_is_ready, 60.0, client.srv_name)
        if client.srv_name not in self._known:
            self.settle()
            self._known.add(client.srv_name)
        future = client.call_async(request)
        self.wait(future.done, timeout, client.srv_name)
        return future.result()

    def close(self) -> str:
        """Ends the processes and the node. Returns what they said."""
        for process, _ in self._started:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process, _ in self._started:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        said = self.said()
        for _, file in self._started:
            file.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
        return said
