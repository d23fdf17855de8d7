"""Quality of service of every topic, in one place (docs/interfaces.md says why)."""

from collections.abc import Callable

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, reliable: bool = True, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


LATCHED = _profile(1, latched=True)  # late joiners see the last one
EVENTS = _profile(100)  # segment_done, anomaly, layer_report: none may be missed
TELEMETRY = _profile(1000)  # 100 Hz or 1 kHz; recorded, so reliable
SENSOR = _profile(1000, reliable=False)  # drivers, which may be best effort; for their bursts
PROFILES = _profile(50)  # batches of profiles, up to a megabyte each
BEAT = _profile(10)  # lease_tick, heartbeat, link_status, weld_command
NEWEST = _profile(1)  # override: only the newest counts


def subscribe_to_driver(
    node: Node, kind: type, topic: str, callback: Callable, depth: int, raw: bool = False
) -> None:
    """Reliable, until a publisher of `topic` offers best effort only; best effort to all of them from then on."""

    def weaker(_: object) -> None:
        node.destroy_subscription(subscription)
        node.create_subscription(kind, topic, callback, _profile(depth, reliable=False), raw=raw)

    subscription = node.create_subscription(
        kind, topic, callback, _profile(depth), raw=raw,
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=weaker),
    )  # fmt: skip
