"""Raw subscriptions to every topic of the graph, emptied by polling.

Taking a message costs 3 us this way; dispatching it through an executor costs 25 to 500 us. The
sequence number that counts losses comes with it (the events executor of these wheels cannot hand it
to a callback).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from .bag_writer import Topic
from .choice import Choice
from .conversions import adapt, is_latched, message_type, qos_dict
from .definitions import DefinitionError, ament_prefixes, full_text
from .loss import LossCounter

DEPTH = (
    5000  # messages that the middleware keeps per topic between two looks: a second of the fastest
)
Sample = tuple[int, 'Tap', bytes, dict]


@dataclass
class Tap:
    """One subscribed topic."""

    topic: Topic
    qos: QoSProfile
    subscription: Subscription
    number: int = -1
    loss: LossCounter = field(default_factory=LossCounter)
    publishers: set[str] = field(default_factory=set)
    offered: int = 0

    @property
    def matched(self) -> bool:
        """All publishers that were in the graph at the last look are connected."""
        return self.subscription.get_publisher_count() >= self.offered


class Taps:
    """All taps of one recording. A node of its own, in no executor, holds them; everything runs in
    the caller's thread."""

    def __init__(self, context: Context, choice: Choice) -> None:
        self._node = Node(
            '_recorder_taps',
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._choice = choice
        self.taps: dict[str, Tap] = {}
        self.skipped: dict[str, str] = {}

    def discover_into(self, add: Callable[[Tap], None]) -> int:
        """Subscribes to topics that have a publisher and no tap yet; `add` gets each new tap.
        Returns their number."""
        before = len(self.taps)
        for name, kinds in self._node.get_topic_names_and_types():
            if tap := self._look(name, kinds):
                add(tap)
        return len(self.taps) - before

    def _look(self, name: str, kinds: list[str]) -> Tap | None:
        if name in self.skipped or not self._choice.wants(name):
            return None
        offers = self._node.get_publishers_info_by_topic(name)
        tap = self.taps.get(name)
        if not offers:
            return None
        if tap is not None:
            self._refresh(tap, offers)
            return None
        try:
            if len(kinds) != 1:
                raise ImportError(f'is published with several types: {", ".join(kinds)}')
            tap = self._tap(name, kinds[0], offers)
        except (DefinitionError, ImportError, AttributeError, ValueError) as e:
            self.skipped[name] = str(e)
            return None
        self.taps[name] = tap
        return tap

    def _tap(self, name: str, kind: str, offers: list) -> Tap:
        hashes = {str(o.topic_type_hash) for o in offers}
        qos = adapt([o.qos_profile for o in offers], DEPTH)
        topic = Topic(
            name,
            kind,
            full_text(kind, ament_prefixes()),
            hashes.pop() if len(hashes) == 1 else '',
            tuple(qos_dict(o.qos_profile) for o in offers),
            is_latched(qos),
        )
        tap = Tap(topic, qos, self._subscribe(name, message_type(kind), qos))
        self._refresh(tap, offers)
        return tap

    def _subscribe(self, name: str, kind: type, qos: QoSProfile) -> Subscription:
        return self._node.create_subscription(kind, name, lambda _: None, qos, raw=True)

    def _refresh(self, tap: Tap, offers: list) -> None:
        """Learns new publishers; subscribes again when one offers less than the others did."""
        tap.offered = len(offers)
        tap.publishers.update(bytes(o.endpoint_gid).hex() for o in offers)
        tap.loss.publishers = max(1, len(tap.publishers))
        weakest = adapt([tap.qos, *(o.qos_profile for o in offers)], DEPTH)
        if (weakest.reliability, weakest.durability) != (tap.qos.reliability, tap.qos.durability):
            self._node.destroy_subscription(tap.subscription)
            tap.qos = weakest
            kind = message_type(tap.topic.type)
            tap.subscription = self._subscribe(tap.topic.name, kind, weakest)

    def unmatched(self) -> list[str]:
        """Topics whose known publishers are not all connected yet."""
        return [name for name, tap in self.taps.items() if not tap.matched]

    def drain(self, limit: int = 2000) -> list[Sample]:
        """Up to `limit` waiting messages of each topic as (receive time ns, tap, data, info), in
        the order of their arrival."""
        samples: list[Sample] = []
        for tap in self.taps.values():
            handle, kind = tap.subscription.handle, tap.subscription.msg_type
            with handle:
                for _ in range(limit):
                    if (taken := handle.take_message(kind, True)) is None:
                        break
                    data, info = taken
                    tap.loss.seen(info['publication_sequence_number'])
                    samples.append((info['received_timestamp'], tap, data, info))
        samples.sort(key=_received)
        return samples

    @property
    def lost(self) -> int:
        """Messages of all topics that are missing by their sequence numbers."""
        return sum(t.loss.lost for t in self.taps.values())

    def losses(self) -> dict[str, int]:
        """Lost messages of the topics that lost any."""
        return {t.topic.name: t.loss.lost for t in self.taps.values() if t.loss.lost}

    def close(self) -> None:
        """Gives all subscriptions up; what was counted stays."""
        self._node.destroy_node()


def _received(sample: Sample) -> int:
    return sample[0]
