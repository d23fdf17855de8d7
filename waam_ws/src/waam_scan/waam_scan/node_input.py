"""The two topics that profiles come on: `profiles` (batches) and `points` (clouds of scanner drivers)."""

from __future__ import annotations

from collections.abc import Callable

from sensor_msgs.msg import PointCloud2

from waam_msgs.msg import ProfileBatch
from waam_node.node import WaamNode
from waam_node.qos import PROFILES, SENSOR

from .conversions import block_from_cloud
from .fusion_params import FusionParams
from .stream.profiles import ProfileBlock, read_batch

Make = Callable[[], tuple[int, ProfileBlock]]


class ProfileInput:
    """Calls take(make) for every message; make() gives its number and ProfileBlock, or ValueError.

    Batches are taken as they come over the wire: a message object would be two more copies of a megabyte.
    Clouds carry no number: they are counted as they come, and what is lost shows as a pause between stamps.
    """

    def __init__(self, node: WaamNode, take: Callable[[Make], None]) -> None:
        self._params: FusionParams = node.params
        self._take, self._clouds = take, 0
        node.create_subscription(ProfileBatch, 'profiles', self._on_profiles, PROFILES, raw=True)
        node.create_subscription(PointCloud2, 'points', self._on_points, SENSOR)

    def _on_profiles(self, data: bytes) -> None:
        self._take(lambda: read_batch(data))

    def _on_points(self, msg: PointCloud2) -> None:
        p, number = self._params, self._clouds
        self._clouds += 1
        period = round(p.points_period * 1e9)
        self._take(lambda: (number, block_from_cloud(msg, p.points_down, p.points_nearest, period)))
