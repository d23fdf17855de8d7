"""The node scan_fusion and a publisher as processes of their own, and scans through them (for bench_scan.py)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from waam_msgs.msg import HeightMap
from waam_msgs.srv import BeginScan, FinishScan
from waam_node.conversions import grid_to_msg, time_to_msg
from waam_node.qos import LATCHED
from waam_process.grid import GridSpec

DOMAIN = 61
GRID = GridSpec(0.0, 0.0, 0.2e-3, 512, 512)
NODE = 'from waam_scan.scan_fusion_node import main; main()'
PARAMETERS = ('mount_xyz:=[0.0, 0.0, 0.11]', 'max_waiting:=20000', 'finish_timeout:=60.0')
PATIENCE = 120.0  # s


@dataclass(frozen=True)
class Run:
    """rate: points/s that were sent and used; lost: anything missing; latency_ms: last batch sent to map received;
    ns_per_point: CPU time of the node; memory_mb: what its process holds at the end."""

    rate: float
    lost: bool
    why: str
    latency_ms: float
    ns_per_point: float
    memory_mb: float


class Graph:
    """Context manager around the two processes."""

    def __init__(self, domain: int = DOMAIN) -> None:
        self._env = os.environ | {'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1'}
        arguments = [a for p in PARAMETERS for a in ('-p', p)]
        self._node = self._start('-c', NODE, '--ros-args', *arguments)
        self._publisher: subprocess.Popen | None = None
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._me = Node('bench_scan', context=self._context)
        self._begin = self._me.create_client(BeginScan, 'scan_fusion/begin')
        self._finish = self._me.create_client(FinishScan, 'scan_fusion/finish')
        self._maps: list[float] = []
        self._me.create_subscription(
            HeightMap, 'height_map', lambda _: self._maps.append(time.monotonic()), LATCHED
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._me)

    def _start(self, *arguments: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, *arguments], env=self._env, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip

    def __enter__(self) -> Graph:
        return self

    def __exit__(self, *error) -> None:
        for process in (self._publisher, self._node):
            if process and process.poll() is None:
                process.terminate()
                process.wait(20)
        self._executor.shutdown()
        self._me.destroy_node()
        rclpy.shutdown(context=self._context)

    def _until(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > end or self._node.poll() is not None:
                raise TimeoutError('the graph does not answer')
            self._executor.spin_once(timeout_sec=0.01)

    def _call(self, client, request):
        self._until(client.service_is_ready)
        for _ in range(int(PATIENCE / 10)):
            future, end = client.call_async(request), time.monotonic() + 30
            self._until(lambda f=future, e=end: f.done() or time.monotonic() > e)
            if future.done():
                return future.result()
        raise TimeoutError(f'{client.srv_name} does not answer')

    def scan(self, rate: float, seconds: float) -> Run:
        """One scan with a fresh publisher of `rate` points per second."""
        script = str(Path(__file__).parent / 'scan_publisher.py')
        self._publisher = self._start(script, str(rate), str(seconds))
        assert self._publisher.stdout.readline().strip() == 'ready'
        cpu = self._cpu_seconds()
        for _ in range(20):  # the scanner's service may not be found at once
            begun = self._call(
                self._begin, BeginScan.Request(job_id='bench', grid=grid_to_msg(GRID))
            )
            if begun.error_code == BeginScan.Response.OK:
                break
        ending = json.loads(self._publisher.stdout.readline())
        seen = len(self._maps)
        request = FinishScan.Request(scan_id=begun.scan_id, until=time_to_msg(ending['until']))
        done = self._call(self._finish, request)
        sent = json.loads(self._publisher.stdout.readline())
        self._until(lambda: len(self._maps) > seen or done.error_code != FinishScan.Response.OK)
        self._publisher.wait(20)
        return self._judge(done, sent, self._cpu_seconds() - cpu)

    def _cpu_seconds(self) -> float:
        """CPU time of the node's process so far."""
        fields = Path(f'/proc/{self._node.pid}/stat').read_text().rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def _memory_mb(self) -> float:
        pages = int(Path(f'/proc/{self._node.pid}/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE') / 1e6

    def _judge(self, done: FinishScan.Response, sent: dict, cpu: float) -> Run:
        used, wanted = done.map.profiles_used, sent['profiles']
        late = sent['points_per_s'] < 0.95 * sent['asked']
        why = f'{wanted - used} of {wanted} profiles missing ({done.message or "no reason given"})'
        if late:
            why = f'the publisher itself reached only {sent["points_per_s"]:.2e} points/s'
        latency = (self._maps[-1] - sent['last']) * 1e3 if self._maps else float('nan')
        cost = cpu * 1e9 / (wanted * sent['points_per_profile'])
        lost = used != wanted or late
        return Run(sent['points_per_s'], lost, why, latency, cost, self._memory_mb())
