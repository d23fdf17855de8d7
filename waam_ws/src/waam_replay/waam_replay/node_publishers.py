"""Raw publishers for recorded topics, with the quality of service that their publishers offered."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from waam_record.bag_writer import Topic
from waam_record.conversions import message_type


def offered(topic: Topic) -> QoSProfile:
    """Reliable unless all recorded publishers were best effort; latched when all of them were."""
    best_effort = bool(topic.qos) and all(q.get('reliability') == 'best_effort' for q in topic.qos)
    return QoSProfile(
        depth=1 if topic.latched else 1000,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


class Publishers:
    """One publisher per topic; topics whose type is not installed here are `missing`."""

    def __init__(self, node: Node, topics: dict[str, Topic], names: dict[str, str]) -> None:
        self._by_name: dict[str, Publisher] = {}
        self.missing: dict[str, str] = {}
        for name, topic in topics.items():
            try:
                kind = message_type(topic.type)
            except (ImportError, AttributeError, ValueError) as e:
                self.missing[name] = f'{topic.type} is not installed here ({e})'
                continue
            self._by_name[name] = node.create_publisher(kind, names[name], offered(topic))

    def __contains__(self, name: str) -> bool:
        return name in self._by_name

    @property
    def names(self) -> set[str]:
        """Topics that can be published."""
        return set(self._by_name)

    def publish(self, name: str, data: bytes) -> None:
        """data: serialised message (CDR). KeyError for a topic that is not among `names`."""
        self._by_name[name].publish(data)
