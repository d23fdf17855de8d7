"""One node as a process of its own on a fresh domain, a client of it, and what processes have used."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def cpu_seconds(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def memory_mb(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


class NodeUnderTest:
    """The node that `module.main` runs, with parameters `name:=value`, and `client`, a node of this process. A context
    manager."""

    def __init__(self, module: str, *parameters: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from waam_node.testing import fresh_domain

        domain = fresh_domain()
        self._env = os.environ | {'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1'}
        self._started: list[subprocess.Popen] = []
        given = [a for p in parameters for a in ('-p', p)]
        main = f'from {module} import main; main()'
        self.process = self.start('-c', main, '--ros-args', *given)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.client = rclpy.create_node('bench', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.client)

    def start(self, *arguments: str) -> subprocess.Popen:
        """A Python process on the same domain, which ends with this object."""
        process = subprocess.Popen(
            [sys.executable, *arguments], env=self._env, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self._started.append(process)
        return process

    def __enter__(self) -> NodeUnderTest:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._started:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._executor.shutdown()
        self.client.destroy_node()
        self._context.try_shutdown()

    def until(self, condition: Callable[[], Any], seconds: float = 120.0) -> None:
        """TimeoutError when it does not become true, or when the node has ended."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end or self.process.poll() is not None:
                raise TimeoutError('the node does not answer')
            self._executor.spin_once(timeout_sec=0.01)

    def call(self, service, request, seconds: float = 30.0):
        """The answer of a service. A server that has not yet found a new client loses its first answer: asked again."""
        self.until(service.service_is_ready)
        for _ in range(4):
            future, end = service.call_async(request), time.monotonic() + seconds
            self.until(lambda f=future, e=end: f.done() or time.monotonic() > e)
            if future.done():
                return future.result()
        raise TimeoutError(f'{service.srv_name} does not answer')
