"""The node `pyrometer`: an instrument beside the controller, or the topic of its driver, as `temperature`."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import Temperature
from std_msgs.msg import Float32, Float64

from waam_node import qos
from waam_node.conversions import temperature_to_msg
from waam_node.node import OK, WARN, WaamNode
from waam_node.node import main as node_main

from .instruments import Reader, instrument
from .pyrometer import TOPIC, PyrometerParams, Reading, address, judged, unknown

NAME = 'temperature'  # what is published
LOOK_S = 0.5  # between two looks at what is silent, and at who publishes
KINDS = {
    'sensor_msgs/msg/Temperature': Temperature,
    'std_msgs/msg/Float32': Float32,
    'std_msgs/msg/Float64': Float64,
}


class Relay:
    """Another node's topic, whatever its quality of service. `take` gets every reading."""

    def __init__(self, node: PyrometerNode, topic: str, take: Callable[[Reading], None]) -> None:
        self._node, self._take = node, take
        self._topic = node.resolve_topic_name(topic)
        if self._topic == node.resolve_topic_name(NAME):
            raise ValueError(f"parameter 'source': {self._topic} is what this node publishes")
        self._kinds: list[str] = []
        self._subscription: Any = None

    def look(self) -> str:
        """Subscribes anew when the type has changed. '' or why there is nothing to subscribe to."""
        found = self._node.get_publishers_info_by_topic(self._topic)
        if not found:
            return f'nobody publishes {self._topic}'
        kinds = sorted({i.topic_type for i in found})
        if kinds == self._kinds:
            return ''
        self._drop()
        if len(kinds) > 1 or kinds[0] not in KINDS:
            return f'{self._topic} is {", ".join(kinds)}, none of {", ".join(KINDS)}'
        kind = KINDS[kinds[0]]
        on = self._on_temperature if kind is Temperature else self._on_number
        self._subscription = self._node.create_subscription(kind, self._topic, on, qos.SENSOR)
        self._kinds = kinds
        return ''

    def _drop(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        self._kinds, self._subscription = [], None

    def _on_temperature(self, msg: Temperature) -> None:
        stamp = msg.header.stamp.sec + msg.header.stamp.nanosec * 1e-9
        age = self._node.now_s() - stamp
        if stamp and abs(age) > self._node.params.timeout:
            self._take(unknown(f'{self._topic}: its stamp is {age:.1f} s old'))
        else:
            self._take(judged(msg.temperature, self._node.params))

    def _on_number(self, msg: Float32 | Float64) -> None:
        self._take(judged(msg.data, self._node.params))


class PyrometerNode(WaamNode):
    """Publishes every reading at once; what is unknown, or silent for `timeout`, is published as NaN and named."""

    def __init__(self) -> None:
        super().__init__('pyrometer', PyrometerParams)
        where = address(self.params.source)
        self._publisher = self.create_publisher(Temperature, NAME, qos.BEAT)
        self._lock = threading.Lock()  # of the newest reading
        self._newest = unknown('no reading yet')
        self._heard = self._now()
        self._reader: Reader | None = None
        self._relay: Relay | None = None
        if where.kind == TOPIC:
            self._relay = Relay(self, where.name, self._take)
        else:
            self._reader = Reader(instrument(where, self.params), self.params.rate, self._take)
            self._reader.start()
        self.create_timer(LOOK_S, self._look, clock=self.steady)

    def close(self) -> None:
        """Ends the reader."""
        if self._reader:
            self._reader.close()

    def responsive(self) -> bool:
        """See WaamNode."""
        return self._reader is None or self._reader.alive

    def _now(self) -> float:
        return self.steady.now().nanoseconds * 1e-9

    def _take(self, reading: Reading) -> None:
        """A reading has just come; from any thread."""
        with self._lock:
            self._newest, self._heard = reading, self._now()
        self._publish(reading)

    def _publish(self, reading: Reading) -> None:
        try:
            ros_ns = self.get_clock().now().nanoseconds
            self._publisher.publish(temperature_to_msg(reading.celsius, ros_ns))
        except Exception:
            if self.context.ok():  # else the node ends
                raise

    def _look(self) -> None:
        why = self._relay.look() if self._relay else ''
        with self._lock:
            silent, reading = self._now() - self._heard, self._newest
        if silent > self.params.timeout:
            old = reading.problem or f'silent for {silent:.1f} s'
            reading = unknown(why or old)
            self._publish(reading)
        self._show(reading)

    def _show(self, reading: Reading) -> None:
        others = self.count_publishers(NAME) - 1
        problem = reading.problem
        if others > 0:
            problem = f'{others} other publishers of {self.resolve_topic_name(NAME)}; {problem}'
        before, self.message = self.message, problem or 'ok'
        self.level = WARN if problem else OK
        known = not math.isnan(reading.celsius)
        self.values = {
            'source': self.params.source,
            'temperature_degC': round(reading.celsius, 1) if known else 'unknown',
        }
        if problem and re.sub(r'\d', '', problem) != re.sub(r'\d', '', before):
            self.get_logger().warning(f'{self.params.source}: {problem}')


def main() -> None:
    node_main(PyrometerNode)
