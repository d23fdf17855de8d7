"""Types and quality of service of the graph <-> what a recording keeps."""

from __future__ import annotations

from importlib import import_module

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

INFINITE_NS = 2**63 - 1
_HISTORY = {HistoryPolicy.KEEP_LAST: 'keep_last', HistoryPolicy.KEEP_ALL: 'keep_all'}
_RELIABILITY = {
    ReliabilityPolicy.RELIABLE: 'reliable',
    ReliabilityPolicy.BEST_EFFORT: 'best_effort',
}
_DURABILITY = {
    DurabilityPolicy.TRANSIENT_LOCAL: 'transient_local',
    DurabilityPolicy.VOLATILE: 'volatile',
}
_LIVELINESS = {
    LivelinessPolicy.AUTOMATIC: 'automatic',
    LivelinessPolicy.MANUAL_BY_TOPIC: 'manual_by_topic',
}


def message_type(name: str) -> type:
    """The Python class of `package/msg/Name`, of an action's feedback message or a service's event.

    Raises ImportError or AttributeError when it is not installed.
    """
    package, kind, base = name.split('/')
    module = import_module(f'{package}.{kind}')
    if kind == 'msg':
        return getattr(module, base)
    owner, part = base.split('_', 1)
    if kind == 'action':
        return getattr(getattr(module, owner).Impl, part)
    return getattr(getattr(module, owner), part)


def qos_dict(qos: QoSProfile) -> dict:
    """One offered profile in the form of rosbag2's metadata (version 9)."""
    return {
        'history': _HISTORY.get(qos.history, 'unknown'),
        'depth': qos.depth,
        'reliability': _RELIABILITY.get(qos.reliability, 'unknown'),
        'durability': _DURABILITY.get(qos.durability, 'unknown'),
        'deadline': _duration(qos.deadline),
        'lifespan': _duration(qos.lifespan),
        'liveliness': _LIVELINESS.get(qos.liveliness, 'unknown'),
        'liveliness_lease_duration': _duration(qos.liveliness_lease_duration),
        'avoid_ros_namespace_conventions': qos.avoid_ros_namespace_conventions,
    }


def _duration(value: Duration) -> dict:
    ns = min(value.nanoseconds, INFINITE_NS)
    return {'sec': ns // 1_000_000_000, 'nsec': ns % 1_000_000_000}


def adapt(offered: list[QoSProfile], depth: int) -> QoSProfile:
    """The strongest profile that all publishers of a topic can serve."""
    reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
    latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def is_latched(qos: QoSProfile) -> bool:
    """Whether a late subscriber still gets the last message (transient local)."""
    return qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
