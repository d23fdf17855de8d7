"""Shared types <-> messages: grids, segments, time. Arrays travel as array.array (numpy arrays cost far more)."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Vector3
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from waam_msgs.msg import BeadPaths, GridInfo
from waam_msgs.msg import Segment as SegmentMsg
from waam_process.grid import GridSpec
from waam_process.segment import Clamp, Kind, Segment


def floats(values: np.ndarray) -> array:
    """float32[] field from any array (row-major)."""
    a = array('f')
    a.frombytes(np.ascontiguousarray(values, np.float32).tobytes())
    return a


def grid_to_msg(spec: GridSpec) -> GridInfo:
    """The origin of the message is the corner of cell (0, 0) in the work frame, m, not turned."""
    pose = Pose(position=Point(x=float(spec.origin_x), y=float(spec.origin_y), z=0.0))
    return GridInfo(resolution=float(spec.resolution), rows=spec.rows, cols=spec.cols, origin=pose)


def grid_from_msg(msg: GridInfo) -> GridSpec:
    """Raises GridError for an invalid geometry."""
    p = msg.origin.position
    return GridSpec(p.x, p.y, msg.resolution, msg.rows, msg.cols)


def map_from_msg(values: array, spec: GridSpec) -> np.ndarray:
    """(rows, cols) float64 from a float32[] field; ValueError when the length does not fit."""
    a = np.frombuffer(values, np.float32) if len(values) else np.empty(0, np.float32)
    if a.size != spec.rows * spec.cols:
        raise ValueError(f'{a.size} values for a grid of {spec.rows} x {spec.cols} cells')
    return a.reshape(spec.shape).astype(float)


def paths_to_msg(paths: Sequence[np.ndarray]) -> BeadPaths:
    """paths: each (n, 2) m, x and y."""
    points = np.concatenate([np.empty((0, 2)), *paths])
    sizes = array('I', [len(p) for p in paths])
    return BeadPaths(x=floats(points[:, 0]), y=floats(points[:, 1]), points=sizes)


def paths_from_msg(msg: BeadPaths) -> list[np.ndarray]:
    """Each (n, 2) m float64; ValueError when the lengths do not fit each other."""
    x, y = (np.asarray(values, np.float32).astype(float) for values in (msg.x, msg.y))
    sizes = np.asarray(msg.points, np.int64)
    if not len(x) == len(y) == sizes.sum():
        raise ValueError(f'{len(x)} x and {len(y)} y for paths of {sizes.sum()} points')
    return np.split(np.stack([x, y], 1), np.cumsum(sizes)[:-1]) if len(sizes) else []


def image_to_msg(z: np.ndarray, header: Header) -> Image:
    """A map as sensor_msgs/Image 32FC1 (m, NaN = unknown), first row = largest y, as viewers show it."""
    data = np.ascontiguousarray(z[::-1], np.float32)
    msg = Image(header=header, height=z.shape[0], width=z.shape[1], encoding='32FC1')
    msg.step = 4 * z.shape[1]
    msg.data = array('B', data.tobytes())
    return msg


_SAME = (
    'index', 'layer', 'bead', 'arc', 'speed', 'wire_feed_speed', 'voltage', 'dwell', 'height', 'width',
    'speed_programmed', 'wire_feed_base', 'psi', 'k_gain', 'residual_height', 'heat_factor', 'flow_factor',
)  # fmt: skip


def segment_to_msg(s: Segment) -> SegmentMsg:
    """Field by field; both are SI in the work frame."""
    msg = SegmentMsg()
    for name in _SAME:
        setattr(msg, name, getattr(s, name))
    msg.kind, msg.clamps = int(s.kind), int(s.clamps)
    for name, kind in (('start', Point), ('end', Point), ('tool_axis', Vector3)):
        x, y, z = getattr(s, name)
        setattr(msg, name, kind(x=float(x), y=float(y), z=float(z)))
    return msg


def segment_from_msg(msg: SegmentMsg) -> Segment:
    """Raises ValueError for an unknown kind; call `Segment.check` for the rest."""
    return Segment(
        kind=Kind(msg.kind),
        clamps=Clamp(msg.clamps),
        start=(msg.start.x, msg.start.y, msg.start.z),
        end=(msg.end.x, msg.end.y, msg.end.z),
        tool_axis=(msg.tool_axis.x, msg.tool_axis.y, msg.tool_axis.z),
        **{name: getattr(msg, name) for name in _SAME},
    )


def time_to_msg(seconds: float) -> Time:
    """Seconds, rounded to the nearest nanosecond."""
    ns = round(seconds * 1e9)
    return Time(sec=ns // 1_000_000_000, nanosec=ns % 1_000_000_000)


def seconds(stamp: Time) -> float:
    """A stamp as a float, s. It resolves about 0.2 us of a date; use `nanoseconds` for differences."""
    return stamp.sec + stamp.nanosec * 1e-9


def nanoseconds(stamp: Time) -> int:
    """A stamp as an integer, ns; exact."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec
