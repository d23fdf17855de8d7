"""Scans through the node scan_fusion by ROS: this process is the machine and its scanner (for bench_scan.py)."""

from __future__ import annotations

import time
from array import array

import numpy as np
from std_srvs.srv import SetBool

from waam_msgs.msg import HeightMap, ProfileBatch, Telemetry
from waam_msgs.srv import BeginScan, FinishScan
from waam_node.conversions import floats, grid_to_msg, time_to_msg
from waam_node.qos import LATCHED, PROFILES, TELEMETRY
from waam_process.grid import GridSpec

from .node import NodeUnderTest

GRID = GridSpec(0.0, 0.0, 0.2e-3, 512, 512)
PARAMETERS = ('mount_xyz:=[0.0, 0.0, 0.11]', 'max_waiting:=20000', 'finish_timeout:=60.0')
POINTS, BATCH, COUNT = (
    2048,
    64,
    15,
)  # of a profile; profiles of a message of one megabyte; messages of a scan
PERIOD = 1e-3  # s between profiles: two million points per second


class ScannedNode(NodeUnderTest):
    """The node, with a machine that moves to and fro over the grid."""

    def __init__(self) -> None:
        super().__init__('waam_scan.scan_fusion_node', *PARAMETERS)
        node, self._on, self._maps = self.client, False, []
        self._begin = node.create_client(BeginScan, 'scan_fusion/begin')
        self._finish = node.create_client(FinishScan, 'scan_fusion/finish')
        node.create_subscription(
            HeightMap, 'height_map', lambda _: self._maps.append(time.monotonic()), LATCHED
        )
        node.create_service(SetBool, 'scanner/enable', self._enable)
        self._telemetry = node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
        self._profiles = node.create_publisher(ProfileBatch, 'profiles', PROFILES)
        rng = np.random.default_rng(0)
        z = -0.11 + 30e-6 * rng.standard_normal(POINTS * BATCH)
        z[rng.random(z.size) < 0.05] = np.nan
        self._msg = ProfileBatch(sensor_id='bench', profile_count=BATCH, points_per_profile=POINTS)
        self._msg.header.frame_id = 'scanner'
        self._msg.x = floats(np.tile(np.linspace(-51.2e-3, 51.2e-3, POINTS), BATCH))
        self._msg.z = floats(z)
        self._msg.stamp_offsets_ns = array('q', [round(k * PERIOD * 1e9) for k in range(BATCH)])
        self.until(
            lambda: all(p.get_subscription_count() for p in (self._telemetry, self._profiles))
        )

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._on, response.success = request.data, True
        return response

    def _batch(self, number: int, start: float) -> None:
        """Telemetry at 100 Hz up to its end and 20 ms on, and a message of profiles. start: s, ROS time, of scan."""
        first, lasts = start + number * BATCH * PERIOD, BATCH * PERIOD
        for t in np.arange(first - 0.02, first + lasts + 0.02, 0.01):
            pose = Telemetry()
            pose.header.stamp = time_to_msg(t)
            pose.position.x = 1.2e-3 + abs((t - start) * 0.1 % 0.2 - 0.1)
            pose.position.y = 51.2e-3
            self._telemetry.publish(pose)
        self._msg.sequence, self._msg.header.stamp = number, time_to_msg(first)
        self._profiles.publish(self._msg)

    def scan(self) -> float:
        """ms from the last message of a scan to its map; RuntimeError when anything is missing."""
        for _ in range(20):  # the scanner's service may not be found at once
            asked = BeginScan.Request(job_id='bench', grid=grid_to_msg(GRID))
            begun = self.call(self._begin, asked)
            if begun.error_code == BeginScan.Response.OK:
                break
        self.until(lambda: self._on)
        start, seen = time.time(), len(self._maps)
        for k in range(COUNT):
            due = start + (k + 1) * BATCH * PERIOD
            self.until(lambda due=due: time.time() > due)
            last = time.monotonic()
            self._batch(k, start)
        end = time_to_msg(start + COUNT * BATCH * PERIOD - PERIOD)
        done = self.call(self._finish, FinishScan.Request(scan_id=begun.scan_id, until=end))
        if done.map.profiles_used != COUNT * BATCH:
            raise RuntimeError(
                f'{done.map.profiles_used} of {COUNT * BATCH} profiles: {done.message}'
            )
        self.until(lambda: len(self._maps) > seen)
        return (self._maps[-1] - last) * 1e3
