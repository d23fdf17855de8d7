"""thermal_compensator: pyrometer in, heat factor and permission for the next layer out."""

from __future__ import annotations

import math

from sensor_msgs.msg import Temperature

from waam_msgs.msg import HeatFactor
from waam_node import node, qos
from waam_node.conversions import time_to_msg

from . import conversions as convert
from .thermal.interpass import Heat, InterpassMonitor
from .thermal.params import ThermalParams


class ThermalCompensator(node.WaamNode):
    """Publishes heat_factor (latched): at once when ready or plausible change, otherwise every
    `period`.
    """

    def __init__(self) -> None:
        super().__init__('thermal_compensator', ThermalParams)
        p: ThermalParams = self.params
        self.settings = p.settings
        self.monitor = InterpassMonitor(p.of_material, self.settings)
        self.publisher = self.create_publisher(HeatFactor, 'heat_factor', qos.LATCHED)
        self.create_subscription(Temperature, 'temperature', self.on_temperature, qos.BEAT)
        self.create_timer(0.5, self.on_timer)
        self.last: Heat | None = None
        self.last_time = -math.inf

    def on_temperature(self, msg: Temperature) -> None:
        stamp, temperature = convert.temperature_sample(msg)
        self.monitor.add(stamp, temperature)
        self.publish(max(stamp, self.now_s()))

    def on_timer(self) -> None:
        self.publish(self.now_s())

    def publish(self, now: float) -> None:
        """Says what holds at ROS time `now` when it is news or the period is over."""
        heat = self.monitor.state(now)
        last = self.last
        news = last is None or (heat.ready, heat.plausible) != (last.ready, last.plausible)
        if not news and 0 <= now - self.last_time < self.params.period:
            return
        self.last, self.last_time = heat, now
        msg = convert.heat_to_msg(heat, self.settings.interpass_limit)
        msg.header.stamp = time_to_msg(now)
        self.publisher.publish(msg)
        self.show(heat, news)

    def show(self, heat: Heat, news: bool) -> None:
        self.level = node.OK if heat.plausible else node.WARN
        self.message = '; '.join(heat.reasons) or ('ready' if heat.ready else 'cooling')
        self.values = {
            'temperature_degC': round(heat.temperature, 1), 'rate_K_s': round(heat.rate, 2),
            'factor': round(heat.factor, 4), 'limit_degC': self.settings.interpass_limit,
        }  # fmt: skip
        if news and not heat.plausible:
            self.get_logger().warning(self.message)


def main() -> None:
    node.main(ThermalCompensator)
