"""Telemetry without a callback per frame: frames are taken raw by polling (3 us each, by an executor 25 to 500)."""

from __future__ import annotations

from rclpy.node import Node

from waam_msgs.msg import Telemetry
from waam_node.qos import TELEMETRY


class TelemetryTap:
    """A subscription on a node of its own that is in no executor; `take` empties it."""

    def __init__(self, owner: Node, name: str) -> None:
        self._node = Node(
            name, context=owner.context, use_global_arguments=False, enable_rosout=False,
            start_parameter_services=False, namespace=owner.get_namespace(),
        )  # fmt: skip
        topic = owner.resolve_topic_name('telemetry')
        self._subscription = self._node.create_subscription(
            Telemetry, topic, lambda _: None, TELEMETRY, raw=True
        )

    def take(self) -> list[bytes]:
        """All serialized frames that have come since the last time."""
        frames, handle = [], self._subscription.handle
        with handle:
            while (taken := handle.take_message(Telemetry, True)) is not None:
                frames.append(taken[0])
        return frames

    def close(self) -> None:
        """Gives the subscription up."""
        self._node.destroy_node()
