"""Profiles, temperature and clock of the cell as messages. Stamps are controller time: ROS time in simulation."""

from __future__ import annotations

from array import array

import numpy as np
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from waam_msgs.msg import ProfileBatch
from waam_node.conversions import floats, stamp_ns

from .plant import Profiles


def clock_to_msg(time_us: int) -> Clock:
    """us of the controller's clock, which is the clock of the cell."""
    return Clock(clock=stamp_ns(1000 * time_us))


class Batcher:
    """Collects profiles into messages of `size`; x (points,) is the lateral coordinate of every profile, m."""

    def __init__(self, x: np.ndarray, size: int) -> None:
        self._x, self._size = np.asarray(x, np.float32), size
        self._full_x = floats(np.tile(self._x, size))
        self._parts: list[Profiles] = []
        self._count = 0
        self._sequence = 0

    def add(self, profiles: Profiles) -> ProfileBatch | None:
        """The message when it is full."""
        self._parts.append(profiles)
        self._count += len(profiles.time_us)
        return self.flush() if self._count >= self._size else None

    def flush(self) -> ProfileBatch | None:
        """The message with what there is; None when there is nothing."""
        if not self._parts:
            return None
        times = np.concatenate([p.time_us for p in self._parts])
        first = int(times[0])
        msg = ProfileBatch(
            header=Header(stamp=stamp_ns(1000 * first), frame_id='scanner'), sensor_id='simulated'
        )
        msg.sequence, self._sequence = self._sequence, self._sequence + 1
        msg.profile_count, msg.points_per_profile = len(times), len(self._x)
        msg.stamp_offsets_ns = array('q', ((times - first) * 1000).astype(np.int64).tobytes())
        same = len(times) == self._size
        msg.x = self._full_x if same else floats(np.tile(self._x, len(times)))
        msg.z = floats(np.concatenate([p.z for p in self._parts]))
        msg.intensity = floats(np.concatenate([p.intensity for p in self._parts]))
        self._parts, self._count = [], 0
        return msg
