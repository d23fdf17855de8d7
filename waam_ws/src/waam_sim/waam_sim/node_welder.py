"""The welding device of the simulated cell of a robot."""

from __future__ import annotations

import threading
from collections.abc import Callable

from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue
from rclpy.node import Node

from waam_node import qos
from waam_node.conversions import stamp_ns

from .plant import INPUT_GAS_OK, OUTPUT_ARC, OUTPUT_GAS, Reading

WELDING = 'welding'
WATCHDOG_US = 100_000  # without outputs for so long the device drops the arc


class Welder:
    """The welding device: outputs from weld_command as long as they come, what it measures on weld_state."""

    def __init__(self, node: Node, now_us: Callable[[], int]) -> None:
        self._node, self._now_us = node, now_us
        self._outputs, self._heard_us = (0, 0.0, 0.0), -WATCHDOG_US
        self._told_us = 0  # time of the newest command, 0 = nobody tells any
        self.news = threading.Event()  # a command has come
        self._out = node.create_publisher(DynamicInterfaceGroupValues, 'weld_state', qos.BEAT)
        node.create_subscription(
            DynamicInterfaceGroupValues, 'weld_command', self._on_command, qos.BEAT
        )

    def behind_us(self) -> int:
        """How far the newest command is behind the cell; 0 where there is none."""
        return self._now_us() - self._told_us if self._told_us else 0

    @property
    def alone(self) -> bool:
        """Nobody tells any commands."""
        return not self._told_us

    def give_up(self) -> None:
        """Nobody waits for commands until the next one comes."""
        self._told_us = 0

    def outputs(self) -> tuple[int, float, float]:
        """Bits, wire (m/s) and voltage (V) that act now."""
        if self._now_us() - self._heard_us > WATCHDOG_US:
            return 0, 0.0, 0.0
        return self._outputs

    def tell(self, reading: Reading, time_us: int) -> None:
        """Publishes what it measures."""
        gas = float(reading.inputs & INPUT_GAS_OK != 0)
        one = InterfaceValue(interface_names=['gas_ok', 'current', 'voltage', 'wire_speed'])
        one.values = [gas, reading.current, reading.voltage, reading.wire_speed]
        msg = DynamicInterfaceGroupValues(interface_groups=[WELDING], interface_values=[one])
        msg.header.stamp = stamp_ns(1000 * time_us)
        self._out.publish(msg)

    def _on_command(self, msg: DynamicInterfaceGroupValues) -> None:
        groups = dict(zip(msg.interface_groups, msg.interface_values, strict=False))
        group = groups.get(WELDING, InterfaceValue())
        found = dict(zip(group.interface_names, group.values, strict=False))
        try:
            bits = OUTPUT_ARC * (found['arc'] > 0.5) | OUTPUT_GAS * (found['gas'] > 0.5)
            self._outputs = (int(bits), found['wire_feed_speed'], found['voltage'])
        except KeyError as e:
            text = f'weld_command: no {e} in the group {WELDING}'
            self._node.get_logger().error(text, throttle_duration_sec=5.0)
            return
        self._heard_us = self._now_us()
        self._told_us = msg.header.stamp.sec * 1_000_000 + msg.header.stamp.nanosec // 1000
        self.news.set()
