"""Messages <-> the project's own types, field by field by their names. Units are those of the message.

`to_msg` makes a message of a dataclass, `from_msg` a dataclass of a message: fields of the same name need no further
word, those of another name or meaning are named in the call. Numbers become int, float or bool as the message wants
them, arrays array.array (numpy arrays cost far more), points tuples, times seconds, grids `GridSpec`.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache, partial
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from sensor_msgs.msg import Image, Temperature
from std_msgs.msg import Header

from waam_msgs.msg import BeadPaths, GridInfo
from waam_msgs.msg import Segment as SegmentMsg
from waam_process.grid import GridSpec
from waam_process.segment import Clamp, Kind, Segment

Made = TypeVar('Made')
TYPECODES = {
    'float': 'f',
    'uint8': 'B',
    'uint16': 'H',
    'uint32': 'I',
    'int64': 'q',
}  # of array.array
UNKNOWN_POINT = (float('nan'),) * 3


def to_msg(
    kind: type[Made], source: Any = None, /, stamp: Time | None = None, frame: str = '', **more: Any
) -> Made:
    """A message of all fields of the dataclass `source`; `more`: further ones, or other values. AttributeError for one
    that the message does not have. stamp, frame: of the header."""
    msg: Any = kind()
    given = {f.name: getattr(source, f.name) for f in fields(source)} if source is not None else {}
    writers = _writers(kind)  # type: ignore[arg-type]
    for name, value in (given | more).items():
        if name not in writers:
            raise AttributeError(f'{kind.__name__} has no field {name!r}')
        setattr(msg, name, writers[name](value))
    if stamp is not None:
        msg.header.stamp, msg.header.frame_id = stamp, frame
    return msg


def from_msg(kind: type[Made], msg: Any, /, **more: Any) -> Made:
    """A dataclass of the fields of the same names; `more`: those that the message has under another name or in another
    form. What is in neither (messages of older records have fewer fields) has its default."""
    names = (f.name for f in fields(kind) if f.init and f.name not in more and hasattr(msg, f.name))  # type: ignore[arg-type]
    return kind(**{name: plain(getattr(msg, name)) for name in names}, **more)


def plain(value: Any) -> Any:
    """A field of a message as the project's own type; a message that has none stays what it is."""
    reader = _READERS.get(type(value))
    return reader(value) if reader else value


def values(typecode: str, numbers: Any) -> array:
    """A field of numbers from any array (row-major) or sequence."""
    made = array(typecode)
    made.frombytes(np.ascontiguousarray(numbers, np.dtype(typecode)).tobytes())
    return made


floats = partial(values, 'f')  # of float32[] fields


def xyz(point: Point | Vector3) -> tuple[float, float, float]:
    """Of a point or vector."""
    return point.x, point.y, point.z


def _point(kind: type, numbers: Sequence[float] | None) -> Any:
    x, y, z = UNKNOWN_POINT if numbers is None else numbers
    return kind(x=float(x), y=float(y), z=float(z))


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


def transform_to_msg(
    parent: str, child: str, at: Sequence[float], rotation: Sequence[float], stamp: Time
) -> TransformStamped:
    """The frame `child` in the frame `parent`; at: (3,) m; rotation: unit quaternion x, y, z, w."""
    x, y, z, w = map(float, rotation)
    turned = Quaternion(x=x, y=y, z=z, w=w)
    placed = Transform(translation=_point(Vector3, at), rotation=turned)
    header = Header(stamp=stamp, frame_id=parent)
    return TransformStamped(header=header, child_frame_id=child, transform=placed)


def segment_to_msg(segment: Segment) -> SegmentMsg:
    """Both are SI in the work frame."""
    return to_msg(SegmentMsg, segment)


def segment_from_msg(msg: SegmentMsg) -> Segment:
    """Raises ValueError for an unknown kind; call `Segment.check` for the rest."""
    return from_msg(Segment, msg, kind=Kind(msg.kind), clamps=Clamp(msg.clamps))


def stamp_ns(ns: int) -> Time:
    """ROS time in ns."""
    sec, nanosec = divmod(ns, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def time_to_msg(seconds: float) -> Time:
    """Seconds, rounded to the nearest nanosecond."""
    return stamp_ns(round(seconds * 1e9))


def temperature_to_msg(celsius: float, ros_ns: int) -> Temperature:
    """Of the part, degC, NaN = unknown; its variance is left unknown (0). ros_ns: ROS time of the reading."""
    return to_msg(Temperature, stamp=stamp_ns(ros_ns), frame='work', temperature=celsius)


def seconds(stamp: Time) -> float:
    """A stamp as a float, s. It resolves about 0.2 us of a date; use `nanoseconds` for differences."""
    return stamp.sec + stamp.nanosec * 1e-9


def nanoseconds(stamp: Time) -> int:
    """A stamp as an integer, ns; exact."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


# ---- what `to_msg` and `from_msg` know of the types of fields

_SIMPLE: dict[str, Callable[[Any], Any]] = {
    'boolean': bool, 'string': str, 'float': float, 'double': float,
    **dict.fromkeys(('uint8', 'uint16', 'uint32', 'uint64', 'int32', 'int64'), int),
    'sequence<string>': list,
}  # fmt: skip
_SHARED: dict[str, Callable[[Any], Any]] = {
    'geometry_msgs/Point': partial(_point, Point), 'geometry_msgs/Vector3': partial(_point, Vector3),
    'builtin_interfaces/Time': time_to_msg, 'waam_msgs/GridInfo': grid_to_msg, 'waam_msgs/BeadPaths': paths_to_msg,
}  # fmt: skip
_READERS: dict[type, Callable[[Any], Any]] = {
    Point: xyz, Vector3: xyz, Time: seconds, GridInfo: grid_from_msg, BeadPaths: paths_from_msg, list: tuple,
}  # fmt: skip


@cache
def _writers(kind: Any) -> dict[str, Callable[[Any], Any]]:
    """For every field of a message: what makes its value."""
    return {name: _writer(text) for name, text in kind.get_fields_and_field_types().items()}


def _writer(kind: str) -> Callable[[Any], Any]:
    if kind in _SIMPLE:
        return _SIMPLE[kind]
    inner = kind.removeprefix('sequence<').removesuffix('>')
    if inner != kind and inner in TYPECODES:
        return partial(values, TYPECODES[inner])
    make = _SHARED.get(kind)
    return lambda value: value if make is None or hasattr(value, 'SLOT_TYPES') else make(value)
