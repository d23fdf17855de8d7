"""Scans through the node scan_fusion and a publisher as processes of their own (for bench_scan.py)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from waam_msgs.msg import HeightMap
from waam_msgs.srv import BeginScan, FinishScan
from waam_node.conversions import grid_to_msg, time_to_msg
from waam_node.qos import LATCHED
from waam_process.grid import GridSpec

from .node import NodeUnderTest, cpu_seconds, memory_mb, told

GRID = GridSpec(0.0, 0.0, 0.2e-3, 512, 512)
PARAMETERS = ('mount_xyz:=[0.0, 0.0, 0.11]', 'max_waiting:=20000', 'finish_timeout:=60.0')


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


class Fusion(NodeUnderTest):
    """The node."""

    def __init__(self) -> None:
        super().__init__('waam_scan.scan_fusion_node', *PARAMETERS)
        self._begin = self.client.create_client(BeginScan, 'scan_fusion/begin')
        self._finish = self.client.create_client(FinishScan, 'scan_fusion/finish')
        self._maps: list[float] = []
        self.client.create_subscription(
            HeightMap, 'height_map', lambda _: self._maps.append(time.monotonic()), LATCHED
        )

    def scan(self, rate: float, seconds: float) -> Run:
        """One scan with a fresh publisher of `rate` points per second."""
        script = str(Path(__file__).with_name('scan_publisher.py'))
        publisher = self.start(script, str(rate), str(seconds))
        told(publisher)
        cpu = cpu_seconds(self.process.pid)
        for _ in range(20):  # the scanner's service may not be found at once
            asked = BeginScan.Request(job_id='bench', grid=grid_to_msg(GRID))
            begun = self.call(self._begin, asked)
            if begun.error_code == BeginScan.Response.OK:
                break
        ending = told(publisher)
        seen = len(self._maps)
        asked = FinishScan.Request(scan_id=begun.scan_id, until=time_to_msg(ending['until']))
        done = self.call(self._finish, asked)
        sent = told(publisher)
        self.until(lambda: len(self._maps) > seen or done.error_code != FinishScan.Response.OK)
        publisher.wait(20)
        used, wanted = done.map.profiles_used, sent['profiles']
        late = sent['points_per_s'] < 0.95 * rate
        why = f'{wanted - used} of {wanted} profiles missing ({done.message or "no reason given"})'
        if late:
            why = f'the publisher itself reached only {sent["points_per_s"]:.2e} points/s'
        latency = (self._maps[-1] - sent['last']) * 1e3 if self._maps else float('nan')
        cost = (cpu_seconds(self.process.pid) - cpu) * 1e9 / (wanted * sent['points_per_profile'])
        lost = used != wanted or late
        return Run(sent['points_per_s'], lost, why, latency, cost, memory_mb(self.process.pid))
