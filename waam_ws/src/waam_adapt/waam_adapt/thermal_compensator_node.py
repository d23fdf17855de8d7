"""thermal_compensator: pyrometer in, heat factor and permission for the next layer out."""

from __future__ import annotations

import math

from sensor_msgs.msg import Temperature

from waam_msgs.msg import HeatFactor, JobStatus, LayerReport
from waam_node import node, qos
from waam_node.conversions import time_to_msg
from waam_process import materials

from . import conversions as convert
from .thermal.interpass import Heat, InterpassMonitor
from .thermal.params import ThermalParams


class ThermalCompensator(node.WaamNode):
    """Publishes heat_factor (latched): at once when it says something new, otherwise every `period`.

    `job_status` names the material that is laid and says when a layer begins; `layer_report` says what its arc brought.
    """

    def __init__(self) -> None:
        super().__init__('thermal_compensator', ThermalParams)
        p: ThermalParams = self.params
        self.monitor = InterpassMonitor(p.of_material, p.settings)
        self.material = self.monitor.material.name
        self.publisher = self.create_publisher(HeatFactor, 'heat_factor', qos.LATCHED)
        self.create_subscription(Temperature, 'temperature', self.on_temperature, qos.BEAT)
        self.create_subscription(JobStatus, 'job_status', self.on_job, qos.LATCHED)
        self.create_subscription(LayerReport, 'layer_report', self.on_layer, qos.EVENTS)
        self.create_timer(0.5, self.on_timer)
        self.last: Heat | None = None
        self.last_time = -math.inf
        self.layer: tuple[str, int, int] | None = None

    def on_job(self, msg: JobStatus) -> None:
        if msg.state in (JobStatus.VALIDATING, JobStatus.PREPARING):
            self.monitor.response.forget()
            self.layer = None
        if msg.material and msg.material != self.material:
            self.use(msg.material)
        layer = (msg.job_id, msg.pass_number, msg.layer)
        if msg.state == JobStatus.DEPOSITING and layer != self.layer:
            self.layer = layer
            self.monitor.response.layer_begins()

    def use(self, name: str) -> None:
        """The job's material decides. One that the table does not hold stops the job: nothing is ready any more."""
        self.material, self.last = name, None
        try:
            material = materials.get(name, self.params.materials_file or None)
        except materials.MaterialError as e:
            self.monitor.material_error = str(e)
            self.get_logger().error(str(e))
        else:
            self.monitor.use(material, self.params.limit_of(material))
            limit = self.monitor.settings.interpass_limit
            self.get_logger().info(f'the job lays {name}: interpass limit {limit:.0f} degC')
        self.publish(self.now_s())

    def on_layer(self, msg: LayerReport) -> None:
        laid = convert.laid_layer(msg, self.monitor.material.arc_efficiency)
        if laid:
            self.monitor.response.layer_ends(laid)

    def on_temperature(self, msg: Temperature) -> None:
        stamp, temperature = convert.temperature_sample(msg)
        self.monitor.add(stamp, temperature)
        self.publish(max(stamp, self.now_s()))

    def on_timer(self) -> None:
        self.publish(self.now_s())

    def publish(self, now: float) -> None:
        """Says what holds at ROS time `now` when it is news or the period is over."""
        heat = self.monitor.state(now)
        news = self.last is None or _words(heat) != _words(self.last)
        if not news and 0 <= now - self.last_time < self.params.period:
            return
        self.last, self.last_time = heat, now
        limit = self.monitor.settings.interpass_limit
        msg = convert.heat_to_msg(heat, limit, self.material)
        msg.header.stamp = time_to_msg(now)
        self.publisher.publish(msg)
        self.show(heat, news)

    def show(self, heat: Heat, news: bool) -> None:
        sound = heat.plausible and heat.believed
        self.level = node.OK if sound else node.WARN
        state = 'ready' if heat.ready else 'cooling'
        self.message = '; '.join((*heat.reasons, *filter(None, [heat.doubt]))) or state
        self.values = {
            'temperature_degC': round(heat.temperature, 1), 'rate_K_s': round(heat.rate, 2),
            'factor': round(heat.factor, 4), 'limit_degC': self.monitor.settings.interpass_limit,
            'material': self.material,
        }  # fmt: skip
        if news and not sound:
            self.get_logger().warning(self.message)


def _words(heat: Heat) -> tuple[bool, bool, str]:
    """What is news when it changes."""
    return heat.ready, heat.plausible, heat.doubt


def main() -> None:
    node.main(ThermalCompensator)
