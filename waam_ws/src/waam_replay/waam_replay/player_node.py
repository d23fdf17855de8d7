"""player: publishes a record to a graph, with /clock; pause, resume, step, seek and rate while it runs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Message
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from waam_node.node import OK, WaamNode
from waam_node.node import main as run_main
from waam_node.params import param
from waam_record.bag_writer import Topic
from waam_record.conversions import message_type
from waam_record.read_record import record_folder

from .play_clock import PlayClock
from .playlist import TF_STATIC, Playlist, Wanted, against_live, parse_remap

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
    exclude: str = param('', 'regular expression; topics it is found in are not published')
    remap: str = param('', 'from:=to, separated by blanks')
    start: float = param(0.0, 'where to begin, after the beginning of the record', 's', 0.0)
    until: float = param(
        0.0, 'where to end, after the beginning of the record; 0 = at its end', 's', 0.0
    )
    paused: bool = param(False, 'begin paused')
    force: bool = param(False, 'publish commands to a machine, and topics that others publish')

    @property
    def wanted(self) -> Wanted:
        """What is to be played. ValueError for a `remap` that is not of the form from:=to."""
        remap = parse_remap(self.remap.split())
        topics = tuple(self.topics.split())
        return Wanted(topics, self.exclude, remap, self.start, self.until, self.force)


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


class Player(WaamNode):
    """Ends the process when the record is over."""

    def __init__(self) -> None:
        super().__init__('player', PlayerParams)
        p = self.params
        if not p.record:
            raise ValueError("player: parameter 'record' is empty: give a job or record folder")
        self.done = False
        self._clock_out = self.create_publisher(Clock, '/clock', QoSProfile(depth=10))
        self._folder = record_folder(Path(p.record))
        self._playlist = Playlist(self._folder, p.wanted)
        self._look()
        taken = {n for n, _ in self.get_topic_names_and_types() if self.count_publishers(n)}
        chosen, refused = self._playlist.allowed(taken)
        names = {n: self._playlist.published_name(n) for n in chosen}
        self._outputs = Publishers(self, chosen, names)
        for name, why in {**refused, **self._outputs.missing}.items():
            self.get_logger().info(f'not published: {name}: {why}')
        begin = self._playlist.first_ns + round(p.start * 1e9)
        self._chosen = chosen
        self._play_time = PlayClock(begin, p.rate, p.paused, time.monotonic() + WAIT_S)
        self._published = self._steps = 0
        self._jump(begin)
        for name, work in (('pause', self._pause), ('resume', self._resume), ('step', self._step)):
            self.create_service(Trigger, f'~/{name}', work)
        self.create_subscription(Float64, '~/seek', self._on_seek, 10)
        self.create_subscription(Float64, '~/rate', self._on_rate, 10)
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
        if why := against_live(set(self.get_node_names()), self.params.wanted):
            raise ValueError(f'player: {why}')

    def _jump(self, at_ns: int) -> None:
        """Continues at a recorded time; latched topics get what they held there."""
        for name, message in self._playlist.latched_before(self._chosen, at_ns):
            if name in self._outputs:
                self._outputs.publish(name, message.data)
        self._stream = self._playlist.messages(self._outputs.names, at_ns)
        self._coming = next(self._stream, None)

    def _tick(self) -> None:
        self._publish_clock(self._play_time.now_ns(time.monotonic()))

    def _publish_clock(self, ns: int) -> None:
        if not self.context.ok():  # the timer was due when the player was stopped
            return
        msg = Clock()
        msg.clock.sec, msg.clock.nanosec = divmod(min(ns, self._playlist.until_ns), 1_000_000_000)
        self._clock_out.publish(msg)

    def _advance(self) -> None:
        now = self._play_time.now_ns(time.monotonic())
        for _ in range(BURST):
            if self._coming is None or not (self._steps or self._due(self._coming[1], now)):
                break
            self._steps = max(0, self._steps - 1)
            self._publish_next(*self._coming)
        self.level, self.message = OK, 'paused' if self._play_time.paused else 'playing'
        position = (now - self._playlist.first_ns) * 1e-9
        self.values = {
            'position_s': f'{position:.2f}',
            'rate': self._play_time.rate,
            'published': self._published,
        }
        if self._coming is None and not self._play_time.paused:
            self._end()

    def _due(self, message: Message, now: int) -> bool:
        """A paused player publishes nothing, not even a message at its present time."""
        return not self._play_time.paused and message.log_time <= now

    def _publish_next(self, name: str, message: Message) -> None:
        if self._play_time.paused:  # a step takes the time with it
            self._play_time.seek(
                max(message.log_time, self._play_time.now_ns(0.0)), time.monotonic()
            )
            self._publish_clock(message.log_time)
        self._outputs.publish(name, message.data)
        self._published += 1
        self._coming = next(self._stream, None)

    def _pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._play_time.pause(time.monotonic())
        response.success = True
        return response

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._play_time.resume(time.monotonic())
        response.success = True
        return response

    def _step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """The next message, while paused."""
        response.success = False
        if self._coming is None:
            response.message = 'the record is over'
        elif not self._play_time.paused:
            response.message = 'pause first'
        else:
            self._steps += 1
            response.success, response.message = True, self._coming[0]
        return response

    def _on_seek(self, msg: Float64) -> None:
        at = self._playlist.first_ns + round(max(0.0, msg.data) * 1e9)
        self._play_time.seek(at, time.monotonic())
        self._jump(at)

    def _on_rate(self, msg: Float64) -> None:
        try:
            self._play_time.set_rate(msg.data, time.monotonic())
        except ValueError as e:
            self.get_logger().error(str(e))

    def _end(self) -> None:
        if not self.done:
            self.done = True
            self.get_logger().info('the record is over')
            self.context.try_shutdown()


def main() -> None:
    run_main(Player)
