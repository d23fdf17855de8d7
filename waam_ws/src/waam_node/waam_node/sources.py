"""Messages with the publisher that they came from. rclpy does not hand that over, so rcl is asked through ctypes.

The global identifier (GID) of a publisher is made by the middleware and comes with every message. Whoever repeats the
text of another node's message has another one. It is no protection against somebody who writes his own middleware:
that is what SROS 2 is for (docs/interfaces.md).
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator
from typing import Any

from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

GID_BYTES = 16
RCL_OK = 0


class _Allocator(ctypes.Structure):  # rcutils_allocator_t
    _fields_ = [(n, ctypes.c_void_p) for n in ('take', 'free', 'grow', 'zero', 'state')]


class _Bytes(ctypes.Structure):  # rcutils_uint8_array_t
    _fields_ = [
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', _Allocator),
    ]


class _Info(ctypes.Structure):  # rmw_message_info_t
    _fields_ = [
        ('source_timestamp', ctypes.c_int64),
        ('received_timestamp', ctypes.c_int64),
        ('publication_sequence_number', ctypes.c_uint64),
        ('reception_sequence_number', ctypes.c_uint64),
        ('implementation', ctypes.c_char_p),  # rmw_gid_t begins
        ('gid', ctypes.c_uint8 * GID_BYTES),
        ('from_intra_process', ctypes.c_bool),
    ]


@functools.cache
def _libraries() -> tuple[Any, Any]:
    """take(subscription, bytes, info, allocation) of rcl, default_allocator() of rcutils; both are loaded already."""
    take = ctypes.CDLL('librcl.so').rcl_take_serialized_message
    take.argtypes = [
        ctypes.c_void_p,
        ctypes.POINTER(_Bytes),
        ctypes.POINTER(_Info),
        ctypes.c_void_p,
    ]
    allocator = ctypes.CDLL('librcutils.so').rcutils_get_default_allocator
    allocator.restype = _Allocator
    return take, allocator


class SourcedSubscription:
    """A subscription that is emptied by `take`, not by an executor: it lives on a hidden node of its own. All methods
    belong to one thread at a time."""

    def __init__(self, context: Context, name: str, kind: type, topic: str, qos: QoSProfile):
        self._node = Node(
            f'_{name}',
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._kind = kind
        self._subscription = self._node.create_subscription(kind, topic, lambda _: None, qos)
        self._take, allocator = _libraries()
        self._bytes, self._info = _Bytes(allocator=allocator()), _Info()

    def take(self) -> Iterator[tuple[Any, str]]:
        """What waits: messages and the GID of their publisher (32 hexadecimal digits), in the order of arrival."""
        handle = self._subscription.handle
        with handle:
            while self._next(handle.pointer):
                data = ctypes.string_at(self._bytes.buffer, self._bytes.length)
                gid = bytes(self._info.gid).hex()
                yield deserialize_message(data, self._kind), gid

    def _next(self, pointer: int) -> bool:
        taken = self._take(pointer, ctypes.byref(self._bytes), ctypes.byref(self._info), None)
        return bool(taken == RCL_OK)

    def publishers(self) -> dict[str, str]:
        """GIDs of all publishers of the topic that are in the graph, and the names of their nodes."""
        found = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        return {bytes(p.endpoint_gid)[:GID_BYTES].hex(): p.node_name for p in found}

    def close(self) -> None:
        """Gives the subscription up."""
        self._node.destroy_node()
