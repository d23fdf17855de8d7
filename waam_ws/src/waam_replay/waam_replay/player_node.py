"""player: publishes a record to a graph, with /clock, from its beginning or a later moment to its end."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from waam_node.node import OK, WaamNode
from waam_node.node import main as run_main
from waam_node.params import param
from waam_record.bag_writer import Topic
from waam_record.conversions import message_type
from waam_record.read_record import record_folder

from .playlist import TF_STATIC, Playlist, Wanted, against_live

BURST = 500  # messages that are published at most before the executor gets its turn
CLOCK_S = 0.01  # wall time between two messages on /clock
LOOK_S = 5.0  # wall time to find the nodes that are there: they announce themselves every 3 s
WAIT_S = 0.5  # wall time between the publishers being there and the first message


@dataclass(frozen=True)
class PlayerParams:
    """Parameters of the node, with default, meaning, unit and limits."""

    record: str = param('', 'job folder or record folder')
    rate: float = param(1.0, 'recorded seconds per second', '', 0.001, 1000.0)
    topics: str = param('', 'names of topics that are published, separated by blanks; empty = all')
    start: float = param(0.0, 'where to begin, after the beginning of the record', 's', 0.0)
    force: bool = param(False, 'publish commands to a machine, and topics that others publish')


def offered(topic: Topic) -> QoSProfile:
    """Reliable unless all recorded publishers were best effort; latched when all of them were."""
    best_effort = bool(topic.qos) and all(q.get('reliability') == 'best_effort' for q in topic.qos)
    return QoSProfile(
        depth=1 if topic.latched and topic.name != TF_STATIC else 1000,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


class Publishers:
    """One publisher per topic; topics whose type is not installed here are `missing`."""

    def __init__(self, node: Node, topics: dict[str, Topic]) -> None:
        self._by_name: dict[str, Publisher] = {}
        self.missing: dict[str, str] = {}
        for name, topic in topics.items():
            try:
                kind = message_type(topic.type)
            except (ImportError, AttributeError, ValueError) as e:
                self.missing[name] = f'{topic.type} is not installed here ({e})'
                continue
            self._by_name[name] = node.create_publisher(kind, name, offered(topic))

    @property
    def names(self) -> set[str]:
        """Topics that can be published."""
        return set(self._by_name)

    def publish(self, name: str, data: bytes) -> None:
        """data: serialised message (CDR). KeyError for a topic that is not among `names`."""
        self._by_name[name].publish(data)


class Player(WaamNode):
    """Ends the process when the record is over."""

    def __init__(self) -> None:
        super().__init__('player', PlayerParams)
        p = self.params
        if not p.record:
            raise ValueError("player: parameter 'record' is empty: give a job or record folder")
        self._wanted = Wanted(tuple(p.topics.split()), p.force)
        self._clock_out = self.create_publisher(Clock, '/clock', QoSProfile(depth=10))
        self._playlist = Playlist(record_folder(Path(p.record)), self._wanted)
        self._look()
        taken = {n for n, _ in self.get_topic_names_and_types() if self.count_publishers(n)}
        chosen, refused = self._playlist.allowed(taken)
        self._outputs = Publishers(self, chosen)
        for name, why in {**refused, **self._outputs.missing}.items():
            self.get_logger().info(f'not published: {name}: {why}')
        self._begin = self._playlist.first_ns + round(p.start * 1e9)
        self._since = time.monotonic() + WAIT_S  # wall time of `_begin`
        self._published = 0
        for name, message in self._playlist.latched_before(chosen, self._begin):
            if name in self._outputs.names:
                self._outputs.publish(name, message.data)
        self._stream = self._playlist.messages(self._outputs.names, self._begin)
        self._coming = next(self._stream, None)
        self.create_timer(0.002, self._advance, clock=self.steady)
        self.create_timer(CLOCK_S, self._tick, clock=self.steady)
        self.create_timer(1.0, self._refuse_live, clock=self.steady)

    def _look(self) -> None:
        """Who is in the graph, and what they publish, is known after a moment. ValueError where it is a machine's."""
        end = time.monotonic() + LOOK_S
        while time.monotonic() < end:
            self._refuse_live()
            time.sleep(0.05)

    def _refuse_live(self) -> None:
        if why := against_live(set(self.get_node_names()), self._wanted):
            raise ValueError(f'player: {why}')

    @property
    def _now_ns(self) -> int:
        """Recorded time."""
        passed = max(0.0, time.monotonic() - self._since)
        return self._begin + round(passed * self.params.rate * 1e9)

    def _tick(self) -> None:
        if not self.context.ok():  # the timer was due when the player was stopped
            return
        msg = Clock()
        now = min(self._now_ns, self._playlist.last_ns)
        msg.clock.sec, msg.clock.nanosec = divmod(now, 1_000_000_000)
        self._clock_out.publish(msg)

    def _advance(self) -> None:
        if time.monotonic() < self._since:
            return
        now = self._now_ns
        for _ in range(BURST):
            if self._coming is None or self._coming[1].log_time > now:
                break
            name, message = self._coming
            self._outputs.publish(name, message.data)
            self._published += 1
            self._coming = next(self._stream, None)
        self.level, self.message = OK, 'playing'
        position = (now - self._playlist.first_ns) * 1e-9
        self.values = {'position_s': f'{position:.2f}', 'published': self._published}
        if self._coming is None and self.context.ok():
            self.get_logger().info('the record is over')
            self.context.try_shutdown()


def main() -> None:
    run_main(Player)
