"""Real processes of this package on a DDS domain of their own, and a client node to talk to them."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.executors import SingleThreadedExecutor

from waam_node.testing import fresh_domain

DOMAIN = fresh_domain()


class Graph:
    """Starts nodes, spins a client node until a condition holds, ends everything."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('adapt_test', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.processes: list[subprocess.Popen] = []
        self.known: set[str] = set()

    def start(self, executable: str, *ros_args: str) -> subprocess.Popen:
        path = Path(get_package_prefix('waam_adapt')) / 'lib' / 'waam_adapt' / executable
        command = [str(path), *(['--ros-args', *ros_args] if ros_args else [])]
        environment = os.environ | {'ROS_DOMAIN_ID': str(DOMAIN)}
        process = subprocess.Popen(
            command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        self.processes.append(process)
        return process

    def wait(self, condition, timeout: float = 90.0, what: str = 'condition') -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f'{what}: not within {timeout} s'
            self.executor.spin_once(timeout_sec=0.05)

    def settle(self) -> None:
        """A server that has not yet found the reader of a new client loses its first answer."""
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, client, request, timeout: float = 60.0):
        self.wait(client.service_is_ready, timeout=60, what=client.srv_name)
        if client.srv_name not in self.known:
            self.settle()
            self.known.add(client.srv_name)
        future = client.call_async(request)
        self.wait(future.done, timeout, client.srv_name)
        return future.result()

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in self.processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stderr.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
