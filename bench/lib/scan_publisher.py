"""Publishes telemetry and profile batches at a given rate: python scan_publisher.py POINTS_PER_S SECONDS.

Prints {} when it is ready, then when `scanner/enable` was called and all but the last batch is out {"until": ROS time}
of the end, then, after it was switched off and the last batch is out, what was sent.
"""

from __future__ import annotations

import json
import sys
import time
from array import array

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

from waam_msgs.msg import ProfileBatch, Telemetry
from waam_node.conversions import floats, time_to_msg
from waam_node.qos import PROFILES, TELEMETRY

POINTS, BATCH = 2048, 64  # a message of one megabyte


class Publisher(Node):
    """A machine that moves to and fro over the grid, and its scanner."""

    def __init__(self) -> None:
        super().__init__('publisher')
        self.on = False
        self._telemetry = self.create_publisher(Telemetry, 'telemetry', TELEMETRY)
        self._profiles = self.create_publisher(ProfileBatch, 'profiles', PROFILES)
        self.create_service(SetBool, 'scanner/enable', self._enable)
        rng = np.random.default_rng(0)
        x = np.tile(np.linspace(-51.2e-3, 51.2e-3, POINTS), BATCH)
        z = -0.11 + 30e-6 * rng.standard_normal(x.size)
        z[rng.random(x.size) < 0.05] = np.nan
        self._msg = ProfileBatch(sensor_id='bench', profile_count=BATCH, points_per_profile=POINTS)
        self._msg.header.frame_id = 'scanner'
        self._msg.x, self._msg.z = floats(x), floats(z)
        self._pose = Telemetry()
        self._told = 0.0

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.on, response.success = request.data, True
        return response

    def tell(self, start: float, until: float) -> None:
        """Telemetry at 100 Hz up to `until` (s, ROS time)."""
        while self._told < until:
            self._told = max(start - 0.02, self._told + 0.01)
            self._pose.header.stamp = time_to_msg(self._told)
            place = abs((self._told - start) * 0.1 % 0.2 - 0.1)
            self._pose.position.x, self._pose.position.y = 1.2e-3 + place, 51.2e-3
            self._telemetry.publish(self._pose)

    def send(self, number: int, start: float, period: float) -> None:
        """One batch whose first profile was taken at `start` (s, ROS time)."""
        msg = self._msg
        msg.sequence, msg.header.stamp = number, time_to_msg(start)
        msg.stamp_offsets_ns = array('q', [round(k * period * 1e9) for k in range(BATCH)])
        self._profiles.publish(msg)

    def matched(self) -> bool:
        return bool(
            self._telemetry.get_subscription_count() and self._profiles.get_subscription_count()
        )


def main(rate: float, seconds: float) -> None:
    rclpy.init()
    node, executor = Publisher(), SingleThreadedExecutor()
    executor.add_node(node)

    def until(condition) -> None:
        while not condition():
            executor.spin_once(timeout_sec=0.01)

    until(node.matched)
    time.sleep(0.5)
    print('{}', flush=True)
    until(lambda: node.on)
    lasts, period = BATCH * POINTS / rate, POINTS / rate
    count = max(2, round(seconds / lasts))
    start, clock = time.time(), time.perf_counter()
    for k in range(count - 1):
        executor.spin_once(timeout_sec=0)
        node.tell(start, start + (k + 1) * lasts + 0.02)
        node.send(k, start + k * lasts, period)
        time.sleep(max(0.0, (k + 1) * lasts - (time.perf_counter() - clock)))
    took = time.perf_counter() - clock
    end = start + count * lasts - period
    print(json.dumps({'until': end}), flush=True)
    until(lambda: not node.on)
    node.tell(start, end + 0.02)
    last = time.monotonic()
    node.send(count - 1, start + (count - 1) * lasts, period)
    reached = (count - 1) * BATCH * POINTS / took
    sent = {'profiles': count * BATCH, 'points_per_profile': POINTS, 'points_per_s': reached}
    print(json.dumps({**sent, 'last': last}), flush=True)
    for _ in range(100):
        executor.spin_once(timeout_sec=0.02)
    rclpy.shutdown()


if __name__ == '__main__':
    main(float(sys.argv[1]), float(sys.argv[2]))
