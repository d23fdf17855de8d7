"""Messages as CDR, without ROS: those of this software from their installed definitions, standard ones by rosbags."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from waam_node.cdr import TelemetryFields, pack_telemetry

from ..bag_writer import BagError, Topic
from ..definitions import DefinitionError, ament_prefixes, full_text
from ..log_column import QOS

TELEMETRY = 'waam_msgs/msg/Telemetry'
PROFILES = 'waam_msgs/msg/ProfileBatch'
FLOAT, TEMPERATURE = 'std_msgs/msg/Float64', 'sensor_msgs/msg/Temperature'
NUMBERS = (
    'x', 'y', 'z', 'travel_speed', 'wire_feed_commanded', 'wire_feed_speed', 'arc_current', 'arc_voltage',
)  # fmt: skip
SILENT: dict[str, Any] = {
    **dict.fromkeys(TelemetryFields._fields, 0),
    **dict.fromkeys(NUMBERS, math.nan),
    'state': 1,
    'speed_override': 1.0,
    'wire_override': 1.0,
}  # telemetry of a log that says nothing; state RUN


@cache
def _store() -> Typestore:
    """The standard types and those of this software, by their installed definitions."""
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        for kind in (TELEMETRY, PROFILES):
            types = get_types_from_msg(full_text(kind, ament_prefixes()), kind)
            store.register({k: v for k, v in types.items() if k not in store.fielddefs})
    except DefinitionError as e:
        raise BagError(f'{e}: run `. ./env.sh` first') from None
    return store


def topic(name: str, kind: str) -> Topic:
    """A topic with a type of this software or a standard one."""
    text, _ = _store().generate_msgdef(kind, ros_version=2)
    return Topic(name, kind, text, _store().hash_rihs01(kind), (QOS,))


def _header(stamp: int, frame: str = '') -> Any:
    types = _store().types
    time = types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9)
    return types['std_msgs/msg/Header'](time, frame)


def number(value: float) -> bytes:
    """std_msgs/Float64 as CDR."""
    return bytes(_store().serialize_cdr(_store().types[FLOAT](value), FLOAT))


def temperature(stamp: int, celsius: float) -> bytes:
    """sensor_msgs/Temperature as CDR; stamp: ns, variance unknown (0)."""
    message = _store().types[TEMPERATURE](_header(stamp), celsius, 0.0)
    return bytes(_store().serialize_cdr(message, TEMPERATURE))


def telemetry(stamp: int, number: int, values: dict[str, float]) -> bytes:
    """values: fields of TelemetryFields, SI; what is not among them is NaN or off. arc_established: 0 or 1."""
    arc = bool(values.get('arc_established', 0.0))
    own = {'controller_us': stamp // 1000, 'sequence': number & 0xFFFFFFFF}
    switches = {'arc_enabled': arc, 'arc_established': arc, 'gas': False}
    return pack_telemetry(stamp, TelemetryFields(**{**SILENT, **values, **own, **switches}))


def profile(stamp: int, number: int, x: np.ndarray, z: np.ndarray, light: np.ndarray) -> bytes:
    """One profile (m,) m, z upwards in the frame of the scanner; light: (m,) or empty."""
    message = _store().types[PROFILES](
        header=_header(stamp, 'scanner'),
        sensor_id='imported',
        sequence=number,
        profile_count=1,
        points_per_profile=len(x),
        stamp_offsets_ns=np.zeros(1, np.int64),
        x=np.asarray(x, np.float32),
        z=np.asarray(z, np.float32),
        intensity=np.asarray(light, np.float32),
    )
    return bytes(_store().serialize_cdr(message, PROFILES))
