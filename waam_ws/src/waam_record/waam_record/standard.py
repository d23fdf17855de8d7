"""Messages of standard types as CDR, without ROS, for imported logs."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore


@cache
def _store() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


class Standard:
    """Definitions, hashes and bytes; stamps in ns."""

    @staticmethod
    def text(name: str) -> str:
        """The definition of a type with those that it contains, as it is kept in a recording."""
        return _store().generate_msgdef(name, ros_version=2)[0]

    @staticmethod
    def hash(name: str) -> str:
        """Type hash of ROS 2 (RIHS01)."""
        return _store().hash_rihs01(name)

    @staticmethod
    def float64(value: float) -> bytes:
        """std_msgs/Float64 as CDR."""
        kind = 'std_msgs/msg/Float64'
        return bytes(_store().serialize_cdr(_store().types[kind](value), kind))

    @staticmethod
    def _header(stamp: int, frame: str = '') -> Any:
        types = _store().types
        time = types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9)
        return types['std_msgs/msg/Header'](time, frame)

    @staticmethod
    def temperature(stamp: int, celsius: float) -> bytes:
        """sensor_msgs/Temperature as CDR; stamp: ns, variance unknown (0)."""
        kind = 'sensor_msgs/msg/Temperature'
        message = _store().types[kind](Standard._header(stamp), celsius, 0.0)
        return bytes(_store().serialize_cdr(message, kind))

    @staticmethod
    def joint_state(stamp: int, names: list[str], positions: list[float]) -> bytes:
        """positions: m or rad."""
        kind, none = 'sensor_msgs/msg/JointState', np.empty(0)
        message = _store().types[kind](
            Standard._header(stamp), names, np.array(positions, float), none, none
        )
        return bytes(_store().serialize_cdr(message, kind))
