"""thermal_compensator: pyrometer in, heat factor and permission for the next layer out."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from sensor_msgs.msg import Temperature

from waam_msgs.msg import HeatFactor
from waam_node import node, qos
from waam_node.conversions import time_to_msg
from waam_node.params import param
from waam_process import materials

from . import conversions as convert
from .thermal.interpass import Heat, InterpassMonitor, Settings


@dataclass(frozen=True)
class ThermalParams:
    material: str = param(materials.DEFAULT, 'whose limits and law hold')
    materials_file: str = param(
        '', "operator's table that adds to or replaces the packaged materials"
    )
    interpass_limit: float = param(
        math.nan, 'the next layer starts below this; NaN = of the material', 'degC', 20.0, 1000.0
    )
    t_min: float = param(-20.0, 'lowest reading that is believed', 'degC', -60.0)
    t_max: float = param(1400.0, 'highest reading that is believed', 'degC', 100.0)
    jump: float = param(150.0, 'change between two samples that is taken for a fault', 'K', 1.0)
    confirm: int = param(5, 'samples in a row that turn a jump into a new level', '', 1, 100)
    step: float = param(
        40.0, 'fall between two samples that no metal cools by: emissivity jump', 'K', 1.0
    )
    step_top: float = param(800.0, 'above this metal may cool that fast', 'degC', 100.0)
    hold: float = param(10.0, 'time after an emissivity jump that nothing is believed', 's', 0.0)
    stuck_time: float = param(10.0, 'a reading that rests so long is stuck; 0 = never', 's', 0.0)
    stuck_band: float = param(0.01, 'and rests means: moves less than this', 'K', 0.0)
    timeout: float = param(2.0, 'silence (ROS time) after which nothing is believed', 's', 0.1)
    window: float = param(3.0, 'over which temperature and rate are fitted', 's', 0.5, 60.0)
    period: float = param(
        0.5, 'shortest time between messages without news (ROS time)', 's', 0.0, 5.0
    )


class ThermalCompensator(node.WaamNode):
    """Publishes heat_factor (latched): at once when ready or plausible change, otherwise every
    `period`.
    """

    def __init__(self) -> None:
        super().__init__('thermal_compensator', ThermalParams)
        p = self.params
        material = materials.get(p.material, p.materials_file or None)
        limit = material.interpass_limit if math.isnan(p.interpass_limit) else p.interpass_limit
        limits = {
            f.name: getattr(p, f.name) for f in fields(Settings) if f.name != 'interpass_limit'
        }
        self.settings = Settings(limit, **limits)
        self.monitor = InterpassMonitor(material, self.settings)
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
