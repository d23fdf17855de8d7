"""The two topics that profiles come on: `profiles` (batches) and `points` (clouds of scanner drivers)."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from waam_msgs.msg import ProfileBatch
from waam_node.qos import PROFILES, SENSOR

from .conversions import block_from_cloud, block_from_msg
from .fusion_params import FusionParams
from .profiles import ProfileBlock


class ProfileInput:
    """Calls take(sequence, make) for every message; make() gives its ProfileBlock or ValueError.

    Clouds carry no number: they are counted as they come, and what is lost shows as a pause between stamps.
    """

    def __init__(self, node: Node, take: Callable[[int, Callable[[], ProfileBlock]], None]) -> None:
        self._params: FusionParams = node.params
        self._take, self._clouds = take, 0
        node.create_subscription(ProfileBatch, 'profiles', self._on_profiles, PROFILES)
        node.create_subscription(PointCloud2, 'points', self._on_points, SENSOR)

    def _on_profiles(self, msg: ProfileBatch) -> None:
        self._take(msg.sequence, lambda: block_from_msg(msg))

    def _on_points(self, msg: PointCloud2) -> None:
        p, number = self._params, self._clouds
        self._clouds += 1
        period = round(p.points_period * 1e9)
        self._take(number, lambda: block_from_cloud(msg, p.points_down, p.points_nearest, period))
