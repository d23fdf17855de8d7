"""Everything the bridge publishes. Called under the node's lock, from the link's thread or from the executor."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Range, Temperature

from waam_msgs.msg import (
    AccelerationBatch,
    Anomaly,
    LeaseTick,
    LinkStatus,
    MachineState,
    SegmentDone,
    Standoff,
    Telemetry,
)
from waam_node import qos
from waam_node.conversions import stamp_ns, temperature_to_msg

from . import conversions, frames
from .core import Bridge
from .csv_log import CsvLog
from .outbox import Notice


class Publishers:
    """Topics of the node, fed from the core. `csv`: the operator's log, or None."""

    def __init__(self, node: Node, core: Bridge, port: str, csv: CsvLog | None) -> None:
        self._node, self._core, self._port, self.csv = node, core, port, csv
        self._acceleration: Publisher | None = None  # of a controller that has an accelerometer
        self._temperature: Publisher | None = None  # of a controller that measures it
        self._counted = (0, 0)  # frames, us: where the telemetry rate is counted from
        publish = node.create_publisher
        self._telemetry = publish(Telemetry, 'telemetry', qos.TELEMETRY)
        self._standoff = publish(Standoff, 'standoff', qos.TELEMETRY)
        self._range = publish(Range, 'standoff_range', qos.TELEMETRY)
        self._state = publish(MachineState, 'machine_state', qos.LATCHED)
        self._done = publish(SegmentDone, 'segment_done', qos.EVENTS)
        self._status = publish(LinkStatus, 'link_status', qos.BEAT)
        self._tick = publish(LeaseTick, 'lease_tick', qos.BEAT)
        self._anomaly = publish(Anomaly, 'anomaly', qos.EVENTS)

    def offer_acceleration(self) -> None:
        """There is an accelerometer: others see the topic from now on."""
        kind, profile = AccelerationBatch, qos.PROFILES
        self._acceleration = self._node.create_publisher(kind, 'acceleration', profile)

    def frame(self, t: frames.Telemetry) -> None:
        """One telemetry frame."""
        link = self._core.link
        ros_ns = link.clock.to_ros_ns(t.t_us)
        self._send(self._telemetry, conversions.telemetry_bytes(t, ros_ns, link.boot))
        if self.csv:
            self._log(self.csv, t, ros_ns)

    def _send(self, publisher: Publisher, msg: Any) -> None:
        """After the context has ended the link runs for another moment; what it publishes then is dropped."""
        try:
            publisher.publish(msg)
        except Exception:
            if self._node.context.ok():
                raise

    def _log(self, csv: CsvLog, t: frames.Telemetry, ros_ns: int) -> None:
        """A full disk must not end the job."""
        try:
            csv.add(t, ros_ns)
        except OSError as e:
            self.csv = None
            self._core.notice(Anomaly.WARNING, 'node', f'the CSV log ends: {e.strerror}')

    def outbox(self) -> None:
        """Publishes what has collected in the core; replies last, after the topics that show their effect."""
        box, stamp = self._core.take_outbox(), self._stamp()
        for found in box.standoff:
            self._publish_standoff(found)
        for reading in box.temperatures:
            self._publish_temperature(reading)
        for batch in box.accelerations:
            if self._acceleration is not None:
                ros_ns = self._core.link.clock.to_ros_ns(batch.t_us)
                self._send(self._acceleration, conversions.acceleration(batch, ros_ns))
        for mark in box.done:
            self._send(self._done, conversions.segment_done(mark, stamp))
        if box.changed:
            self._publish_state(stamp)
        for notice in box.notices:
            self._publish_notice(notice, stamp)
        if box.tick_us is not None:
            boot = self._core.link.boot
            tick = LeaseTick(stamp=stamp, controller_us=box.tick_us, boot_id=boot)
            self._send(self._tick, tick)
        for reply in box.replies:
            reply()

    def second(self) -> LinkStatus:
        """What is published at 1 Hz."""
        link, stamp = self._core.link, self._stamp()
        frames_then, us_then = self._counted
        us = link.telemetry.t_us if link.telemetry else 0
        rate = (link.received - frames_then) / (us - us_then) * 1e6 if us > us_then else 0.0
        self._counted = (link.received, us)
        msg = conversions.link_status(self._core, rate, stamp)
        self._send(self._status, msg)
        self._publish_state(stamp)
        return msg

    def _stamp(self) -> Time:
        """ROS time of the last telemetry, or now."""
        link = self._core.link
        if link.telemetry and link.clock.ready:
            return stamp_ns(link.clock.to_ros_ns(link.telemetry.t_us))
        return self._node.get_clock().now().to_msg()

    def _publish_state(self, stamp: Time) -> None:
        self._send(self._state, conversions.machine_state(self._core, self._port, stamp))

    def _publish_standoff(self, found: frames.Standoff) -> None:
        ros_ns = self._core.link.clock.to_ros_ns(found.t_us)
        self._send(self._standoff, conversions.standoff(found, ros_ns))
        seen = conversions.distance(found, ros_ns)
        if seen is not None:
            self._send(self._range, seen)

    def _publish_temperature(self, found: frames.PartTemperature) -> None:
        if self._temperature is None:
            self._temperature = self._node.create_publisher(Temperature, 'temperature', qos.BEAT)
        ros_ns = self._core.link.clock.to_ros_ns(found.t_us)
        self._send(self._temperature, temperature_to_msg(found.celsius, ros_ns))

    def _publish_notice(self, notice: Notice, stamp: Time) -> None:
        self._send(self._anomaly, conversions.anomaly(self._core, notice, stamp))
        log = self._node.get_logger()
        if notice.severity == Anomaly.INFO:  # rclpy wants one severity per place in the code
            log.info(notice.text)
        elif notice.severity == Anomaly.WARNING:
            log.warning(notice.text)
        else:
            log.error(notice.text)
