"""Messages of this software as bytes, without ROS, from their installed definitions."""

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
from ..standard import Standard

TELEMETRY = 'waam_msgs/msg/Telemetry'
PROFILES = 'waam_msgs/msg/ProfileBatch'
MAP = 'waam_msgs/msg/HeightMap'
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
    store = get_typestore(Stores.ROS2_JAZZY)
    for kind in (TELEMETRY, PROFILES, MAP):
        types = get_types_from_msg(_text(kind), kind)
        store.register({k: v for k, v in types.items() if k not in store.fielddefs})
    return store


@cache
def _text(kind: str) -> str:
    try:
        return full_text(kind, ament_prefixes())
    except DefinitionError as e:
        raise BagError(f'{e}: run `. ./env.sh` first') from None


def own_topic(name: str, kind: str) -> Topic:
    """A topic with a type of this software."""
    return Topic(name, kind, _text(kind), _store().hash_rihs01(kind), (QOS,))


def standard_topic(name: str, kind: str) -> Topic:
    """A topic with a standard type."""
    return Topic(name, kind, Standard.text(kind), Standard.hash(kind), (QOS,))


def _header(stamp: int, frame: str) -> Any:
    types = _store().types
    time = types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9)
    return types['std_msgs/msg/Header'](time, frame)


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


def heights(stamp: int, layer: int, number: int, z: np.ndarray, length: float) -> bytes:
    """A row of cells, one per segment of this length (m), with heights z (n,) m, NaN = none."""
    types = _store().types
    point, turn = types['geometry_msgs/msg/Point'], types['geometry_msgs/msg/Quaternion']
    pose = types['geometry_msgs/msg/Pose'](point(0.0, 0.0, 0.0), turn(0.0, 0.0, 0.0, 1.0))
    grid = types['waam_msgs/msg/GridInfo'](length, 1, len(z), pose)
    known = np.isfinite(z)
    nothing = np.full(len(z), np.nan, np.float32)
    message = types[MAP](
        header=_header(stamp, 'work'),
        job_id='',
        scan_id=number,
        layer=layer,
        grid=grid,
        z=np.asarray(z, np.float32),
        sigma=nothing,
        count=known.astype(np.uint16),
        coverage=float(known.mean()),
        plausible=True,
        reasons=['imported: heights by segment, no uncertainty'],
        profiles_used=0,
        profiles_rejected=0,
        points_used=int(known.sum()),
        points_rejected=0,
        residual=math.nan,
        bead_width=math.nan,
        bead_width_u=math.nan,
        bead_width_expected=math.nan,
        bead_width_sections=0,
    )
    return bytes(_store().serialize_cdr(message, MAP))
