"""ROS 1 messages as ROS 2 messages: same fields, but headers without their number."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

STANDARD = (
    'std_msgs', 'sensor_msgs', 'geometry_msgs', 'nav_msgs', 'builtin_interfaces', 'diagnostic_msgs',
    'trajectory_msgs', 'shape_msgs', 'stereo_msgs', 'visualization_msgs', 'actionlib_msgs', 'tf2_msgs',
)  # fmt: skip


class Converter:
    """Definitions and CDR bytes of what `source` (the types of a bag) describes; is2: the bag is ROS 2 already."""

    def __init__(self, source: Typestore, is2: bool) -> None:
        self._source, self._is2 = source, is2
        self._target = source if is2 else get_typestore(Stores.ROS2_JAZZY)
        self._ready: set[str] = set()

    def definition(self, name: str) -> tuple[str, str]:
        """Full ROS 2 text and type hash."""
        self._prepare(name)
        text, _ = self._target.generate_msgdef(name, ros_version=2)
        return text, self._target.hash_rihs01(name)

    def _prepare(self, name: str) -> None:
        """Types of the bag's own packages join the ROS 2 store, with its headers and standard types."""
        if self._is2 or name in self._ready:
            return
        self._ready.add(name)
        if name in self._target.fielddefs:
            return
        text, _ = self._source.generate_msgdef(name, ros_version=2)
        own = get_types_from_msg(text, name)
        known = self._target.fielddefs
        self._target.register({k: v for k, v in own.items() if k not in known})

    def cdr(self, raw: bytes, name: str) -> bytes:
        """One message as CDR."""
        if self._is2:
            return bytes(raw)
        self._prepare(name)
        message = self._source.deserialize_ros1(raw, name)
        return bytes(self._target.serialize_cdr(self._moved(message, name), name))

    def _moved(self, message: Any, name: str) -> Any:
        fields = self._target.fielddefs[name][1]
        values = {f: self._value(getattr(message, f, None), kind) for f, kind in fields}
        return self._target.types[name](**values)

    def _value(self, value: Any, kind: tuple) -> Any:
        node, detail = kind
        if node == Nodetype.NAME:
            return self._moved(value, detail)
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) and detail[0][0] == Nodetype.NAME:
            return [self._moved(v, detail[0][1]) for v in value]
        return value
