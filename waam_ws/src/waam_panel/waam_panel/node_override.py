"""The operator's override: said again until the machine shows it. Nothing answers a topic, so the echo is the answer.

It is not latched: a bridge that starts later begins with factors of 1, and an order of yesterday must not act on it.
"""

from __future__ import annotations

import time

from rclpy.node import Node

from waam_msgs.msg import Override, ProcessControl, Telemetry
from waam_node.override import in_force
from waam_node.qos import NEWEST

from .operations import Refused

READERS_S = 2.0  # for the bridge, and then for whoever else is to hear of it
ECHO_S = 5.0
AGAIN_S = 0.5
LOOK_S = 0.02


class OverrideOrder:
    """`telemetry` and `process` are told what arrives, by the executor; `send` belongs to a worker thread."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._out = node.create_publisher(Override, 'override', NEWEST)
        self._seen: tuple[float, Telemetry] | None = None  # s, steady clock
        self._control: tuple[float, ProcessControl] | None = None

    def telemetry(self, message: Telemetry) -> None:
        """The newest frame."""
        self._seen = time.monotonic(), message

    def process(self, message: ProcessControl) -> None:
        """The newest word of the process control."""
        self._control = time.monotonic(), message

    def send(self, speed: float, wire: float) -> str:
        """Factors, NaN = as it is. What is in force then; Refused when the machine does not show them in time."""
        self._await_readers()
        message = Override(speed_factor=speed, wire_factor=wire, source='panel')
        end = time.monotonic() + ECHO_S
        while time.monotonic() < end:
            message.header.stamp = self._node.get_clock().now().to_msg()
            said = time.monotonic()
            self._out.publish(message)
            while time.monotonic() < said + AGAIN_S:
                if self._shown(speed, wire, said):
                    asked = [f'{n} {f:g}' for n, f in (('speed', speed), ('wire', wire)) if f == f]
                    return f'override in force: {", ".join(asked)}'
                time.sleep(LOOK_S)
        fresh = self._seen is not None and self._seen[0] > end - ECHO_S
        why = 'telemetry does not show it' if fresh else 'there is no telemetry'
        raise Refused(f'override: not in force after {ECHO_S:.0f} s, {why}')

    def _await_readers(self) -> None:
        """Refused without a bridge. The job, which notes it, and a process control get the time to be connected."""
        end = time.monotonic() + READERS_S
        while True:
            readers = self._node.get_subscriptions_info_by_topic(self._out.topic_name)
            bridge = any(r.node_name == 'bridge' for r in readers)
            if bridge and self._out.get_subscription_count() >= len(readers):
                return
            if time.monotonic() > end:
                if bridge and self._out.get_subscription_count():
                    return
                raise Refused('override: nobody takes it, the bridge is not in the graph')
            time.sleep(LOOK_S)

    def _shown(self, speed: float, wire: float, since: float) -> bool:
        """By a frame after `since`."""
        if self._seen is None or self._seen[0] < since:
            return False
        fresh = self._control is not None and self._control[0] > since - 1.0
        control = self._control[1] if fresh and self._control else None
        return in_force(self._seen[1], control, speed, wire)
