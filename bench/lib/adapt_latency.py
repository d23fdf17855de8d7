"""Round trip of the real correction server, in a process of its own: request and answer converted, 256 x 256 cells,
beads told."""

from __future__ import annotations

import math
import os
import subprocess
import time
from pathlib import Path

import numpy as np

SIZE = 256
PREPARATION_S = 0.5  # of wall time, as while the layer before is laid; a job has minutes


class Server:
    """A correction_server with one law on a domain of its own, and a client."""

    def __init__(self, law: str) -> None:
        import rclpy
        from ament_index_python.packages import get_package_prefix
        from rclpy.executors import SingleThreadedExecutor

        from waam_msgs.msg import NextLayer
        from waam_msgs.srv import ComputeCorrection
        from waam_node import qos
        from waam_node.testing import fresh_domain

        domain = fresh_domain()
        program = (
            Path(get_package_prefix('waam_adapt')) / 'lib' / 'waam_adapt' / 'correction_server'
        )
        self.process = subprocess.Popen(
            [str(program), '--ros-args', '-p', f'law:={law}', '-p', 'max_age:=1e9'],
            env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('bench_adapt', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.client = self.node.create_client(ComputeCorrection, 'correction_server/compute')
        self.next_layer = self.node.create_publisher(NextLayer, 'next_layer', qos.LATCHED)
        if not self.client.wait_for_service(timeout_sec=60):
            self.close()
            raise RuntimeError('correction_server does not answer')
        time.sleep(1.0)  # a server that has not yet found a new client loses its first answer

    def call(self, request, timeout: float = 30.0):
        """The answer, or None."""
        future = self.client.call_async(request)
        end = time.monotonic() + timeout
        while not future.done() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
        return future.result() if future.done() else None

    def announce(self, r) -> None:
        """Tells the layer of a request and gives the time to prepare it."""
        from waam_msgs.msg import NextLayer

        self.next_layer.publish(
            NextLayer(
                job_id=r.job_id, layer=r.layer, grid=r.map.grid, planned_height=r.planned_height,
                bead_width=r.bead_width, direction=r.direction, paths=r.paths,
            )
        )  # fmt: skip
        time.sleep(PREPARATION_S)

    def memory_mb(self) -> float:
        """Largest resident memory of the server so far."""
        for line in Path(f'/proc/{self.process.pid}/status').read_text().splitlines():
            if line.startswith('VmHWM'):
                return float(line.split()[1]) / 1024
        return math.nan

    def close(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if hasattr(self, 'executor'):
            self.executor.shutdown()
            self.node.destroy_node()
            self.context.try_shutdown()


def request(node, number: int, size: int = SIZE):
    """A pad of 28 x 28 beads' widths with an uneven surface, another one for every number, and its beads."""
    from waam_msgs.srv import ComputeCorrection
    from waam_node.conversions import floats, grid_to_msg, paths_to_msg
    from waam_process.grid import GridSpec

    spec = GridSpec(0.0, 0.0, 0.7e-3, size, size)
    rng = np.random.default_rng(number)
    x, y = np.meshgrid(spec.x, spec.y)
    wave = 0.3e-3 * np.sin(x / 17e-3 + rng.uniform(0, 6)) * np.cos(y / 13e-3 + rng.uniform(0, 6))
    z = wave + 30e-6 * rng.standard_normal(spec.shape)
    z[rng.random(spec.shape) < 0.01] = np.nan
    inside = np.zeros(spec.shape, bool)
    inside[8:-8, 8:-8] = True
    r = ComputeCorrection.Request(
        job_id=f'bench{number}', layer=1, bead_width=6e-3, temperature=150.0
    )
    r.map.header.stamp = node.get_clock().now().to_msg()
    r.map.job_id, r.map.layer, r.map.plausible = r.job_id, 0, True
    r.map.grid = grid_to_msg(spec)
    r.map.z, r.map.sigma = floats(z), floats(np.full(spec.shape, 3e-5))
    r.target = floats(np.where(inside, 0.0, np.nan))
    r.planned_height = floats(np.where(inside, 2e-3, 0.0))
    r.k_gain, r.direction.x = math.nan, 1.0
    r.paths = paths_to_msg([np.array(b) for b in zigzag(spec, number)])
    return r


def zigzag(spec, turn: int) -> list[list[tuple[float, float]]]:
    """The pad's beads in segments of 2 mm, turned round and moved a little with every layer: none comes back."""
    low, high = 8 * spec.resolution, (spec.cols - 8) * spec.resolution
    x = np.linspace(low, high, round((high - low) / 2e-3) + 1)
    rows = np.arange(low + 2.2e-3, high, 4.4e-3) + 1e-6 * turn
    return [
        [(float(v), float(y)) for v in (x if (i + turn) % 2 else x[::-1])]
        for i, y in enumerate(rows)
    ]


def measure(law: str, calls: int, announced: bool = True) -> dict[str, float]:
    """p50, p99 and largest round trip in ms as the client sees it, the server's own p99, its memory, fallbacks.
    announced: every layer is told before it is asked for, as a job does."""
    server = Server(law)
    try:
        while server.call(request(server.node, 0), 5.0) is None:
            pass
        trips, inside, fallbacks = [], [], 0
        for n in range(calls + 3):
            r = request(server.node, n)
            if announced:
                server.announce(r)
            begin = time.perf_counter()
            answer = server.call(r)
            if n >= 3:  # the first ones warm caches
                trips.append((time.perf_counter() - begin) * 1e3)
                inside.append(answer.correction.latency * 1e3)
                fallbacks += answer.correction.fallback
        return {
            'p50': float(np.quantile(trips, 0.5)), 'p99': float(np.quantile(trips, 0.99)),
            'max': max(trips), 'server_p99': float(np.quantile(inside, 0.99)),
            'memory_mb': server.memory_mb(), 'fallbacks': fallbacks,
        }  # fmt: skip
    finally:
        server.close()
