"""thermal_compensator: pyrometer in, heat factor and permission for the next layer out."""

from __future__ import annotations

import math

from sensor_msgs.msg import Temperature

from waam_msgs.msg import HeatFactor, JobStatus, LayerReport
from waam_node import node, qos
from waam_node.conversions import time_to_msg

from . import answers
from . import conversions as convert
from .thermal.compensator import Compensator
from .thermal.interpass import Heat
from .thermal.params import ThermalParams

PERIOD = 0.5  # s of ROS time, shortest between two messages without news


class ThermalCompensator(node.WaamNode):
    """Publishes heat_factor (latched): at once when it says something new, otherwise every PERIOD.

    `job_status` names the material that is laid and says when a layer begins; `layer_report` says what its arc brought.
    """

    def __init__(self) -> None:
        super().__init__('thermal_compensator', ThermalParams)
        self.compensator = Compensator(self.params)
        self.publisher = self.create_publisher(HeatFactor, 'heat_factor', qos.LATCHED)
        self.create_subscription(Temperature, 'temperature', self.on_temperature, qos.SENSOR)
        self.create_subscription(JobStatus, 'job_status', self.on_job, qos.LATCHED)
        self.create_subscription(LayerReport, 'layer_report', self.on_layer, qos.EVENTS)
        self.create_timer(0.5, self.on_timer)
        self.last: Heat | None = None
        self.last_time = -math.inf

    def on_job(self, msg: JobStatus) -> None:
        """The job names its material, and begins and lays its layers."""
        if not answers.follow_job(self.compensator, msg):
            return
        c, self.last = self.compensator, None
        if c.error:
            self.get_logger().error(c.error)
        else:
            text = f'the job lays {c.material}: interpass limit {c.limit:.0f} degC'
            self.get_logger().info(text)
        self.publish(self.now_s())

    def on_layer(self, msg: LayerReport) -> None:
        """What the arc brought in a layer, for the test whether the temperature answers to it."""
        answers.follow_layer(self.compensator, msg)

    def on_temperature(self, msg: Temperature) -> None:
        """A reading; news go out at once."""
        stamp, temperature = convert.temperature_sample(msg)
        self.compensator.add(stamp, temperature)
        self.publish(max(stamp, self.now_s()))

    def on_timer(self) -> None:
        """Without readings there are news too: silence."""
        self.publish(self.now_s())

    def publish(self, now: float) -> None:
        """Says what holds at ROS time `now` when it is news or the period is over."""
        heat = self.compensator.state(now)
        news = self.last is None or _words(heat) != _words(self.last)
        if not news and 0 <= now - self.last_time < PERIOD:
            return
        self.last, self.last_time = heat, now
        msg = convert.heat_to_msg(heat, self.compensator.limit, self.compensator.material)
        msg.header.stamp = time_to_msg(now)
        self.publisher.publish(msg)
        self.show(heat, news)

    def show(self, heat: Heat, news: bool) -> None:
        """For the diagnostics; news: also into the log."""
        sound = heat.plausible and heat.believed
        self.level = node.OK if sound else node.WARN
        state = 'ready' if heat.ready else 'cooling'
        self.message = '; '.join((*heat.reasons, *filter(None, [heat.doubt]))) or state
        self.values = {
            'temperature_degC': round(heat.temperature, 1), 'rate_K_s': round(heat.rate, 2),
            'factor': round(heat.factor, 4), 'limit_degC': self.compensator.limit,
            'material': self.compensator.material,
        }  # fmt: skip
        if news and not sound:
            self.get_logger().warning(self.message)


def _words(heat: Heat) -> tuple[bool, bool, str]:
    """What is news when it changes."""
    return heat.ready, heat.plausible, heat.doubt


def main() -> None:
    node.main(ThermalCompensator)
