"""Heartbeats with their publishers; one that speaks for another node is not believed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from rclpy.node import Node
from rclpy.qos import QoSProfile

from waam_msgs.msg import Heartbeat
from waam_node import qos
from waam_node.sources import SourcedSubscription

LOOK_S = 0.2  # between two looks at the graph for the name of a publisher


class Beats:
    """tell: is called once with what is wrong with a publisher."""

    def __init__(self, node: Node, tell: Callable[[str], None]) -> None:
        beats = QoSProfile(depth=100, reliability=qos.BEAT.reliability)
        self._subscription = SourcedSubscription(
            node.context, 'bridge_beats', Heartbeat, node.resolve_topic_name('heartbeat'), beats
        )
        self._tell, self._told = tell, set[tuple[str, str]]()
        self._names: dict[str, str] = {}  # of nodes, by publisher
        self._looked = 0.0

    def take(self) -> Iterator[tuple[Heartbeat, str]]:
        """Heartbeats that have arrived and their publishers. Those of a publisher whose node the graph does not name
        yet, or names otherwise than the message, are left out."""
        for beat, publisher in self._subscription.take():
            name = self._name(publisher)
            if name == beat.node:
                yield beat, publisher
            elif name and (publisher, beat.node) not in self._told:
                self._told.add((publisher, beat.node))
                self._tell(f"node '{name}' sends heartbeats of '{beat.node}': not believed")

    def _name(self, publisher: str) -> str:
        """Of the publisher's node, '' = not known yet."""
        now = time.monotonic()
        if publisher not in self._names and now - self._looked > LOOK_S:
            self._looked = now
            found = self._subscription.publishers()
            self._names = {p: n for p, n in found.items() if not n.startswith('_NODE_NAME_UNKNOWN')}
        return self._names.get(publisher, '')

    def close(self) -> None:
        """Gives the subscription up."""
        self._subscription.close()
