"""process_control: telemetry and the operator's override in, factors on speed and wire out."""

from __future__ import annotations

import time

from waam_msgs.msg import Override, ProcessControl, Telemetry
from waam_node import node, qos

from .process_control import control, conversions
from .process_control.params import ProcessControlParams

STALE_PERIOD = 0.1  # s, steady time, between two messages while telemetry is stale


class ProcessControlNode(node.WaamNode):
    """Publishes `process_override`, which the bridge multiplies with the operator's, and `process_control`.

    Switched off (`value: none`) it subscribes to nothing and publishes neither.
    """

    def __init__(self) -> None:
        super().__init__('process_control', ProcessControlParams)
        self.message = 'off'
        if self.params.value == 'none':
            return
        self.control = control.ProcessControl(self.params)
        self.heard = time.monotonic()
        self.last: Telemetry | None = None
        self.factors = self.create_publisher(Override, 'process_override', qos.NEWEST)
        self.status = self.create_publisher(ProcessControl, 'process_control', qos.TELEMETRY)
        self.create_subscription(Telemetry, 'telemetry', self.on_telemetry, qos.TELEMETRY)
        self.create_subscription(Override, 'override', self.on_override, qos.NEWEST)
        self.create_timer(STALE_PERIOD, self.on_timer, clock=self.steady)

    def on_override(self, msg: Override) -> None:
        """What the operator wants is no error."""
        self.control.on_operator(msg.speed_factor, msg.wire_factor)

    def on_telemetry(self, msg: Telemetry) -> None:
        """A step of the control, when it is due."""
        self.heard, self.last = time.monotonic(), msg
        if self.control.add(conversions.process_sample(msg)) is not None:
            self.publish(msg)

    def on_timer(self) -> None:
        """Without telemetry the factors stay, and are said again: the bridge takes them away from a dead node."""
        if self.last is None or time.monotonic() - self.heard < self.params.timeout:
            return
        self.control.freeze('telemetry is stale')
        self.publish(self.last)

    def publish(self, seen: Telemetry) -> None:
        """Factors and status; `seen`: the telemetry that they come from."""
        factors = self.control.factors
        order = Override(
            speed_factor=factors.speed, wire_factor=factors.wire, source='process_control'
        )
        order.header.stamp = seen.header.stamp
        self.factors.publish(order)
        self.status.publish(conversions.process_status(self.control, seen))
        status = self.control.status
        self.level = node.WARN if status.limited or 'stale' in status.reason else node.OK
        self.message = status.reason or ('at its limit' if status.limited else 'holds')
        self.values = {
            'value': self.params.value, 'reference': round(status.reference, 3),
            'measured': round(status.measured, 3), 'speed_factor': round(factors.speed, 4),
            'wire_factor': round(factors.wire, 4),
        }  # fmt: skip


def main() -> None:
    node.main(ProcessControlNode)
