"""The node `bridge`: parameters, topics and services around the core.

Lines are handled and published in the transport's thread: handing each frame to the executor costs a wake-up and a
change of thread, and a long callback of the executor would then hold up the heartbeat. One lock guards the core.
"""

from __future__ import annotations

import sys
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Temperature
from std_srvs.srv import Trigger

from waam_msgs.msg import Heartbeat, LeaseTick, LinkStatus, Override
from waam_node import qos
from waam_node.namesake import PROCESS
from waam_node.node import ERROR, OK, WARN, WaamNode
from waam_node.node import main as node_main
from waam_node.stop_socket import STOP

from . import commands, frames, overrides
from .acceleration import CAPABILITY
from .conversions import diagnostic_values
from .core import Bridge
from .csv_log import CsvLog
from .node_beats import Beats
from .node_frames import FramePublishers, Gantry
from .node_publishers import Publishers
from .node_services import Services
from .node_stop import StopLane
from .outbox import WARNING
from .params import BridgeParams, CommonParams
from .transport import SerialTransport, Transport

ALIGN = 5e-5  # s that reading both clocks may take
BEATS_S = 0.01  # a heartbeat that came just after the call that tells of it waits no longer
FRAMES_S = 0.04  # between two messages on /tf, steady clock
SWITCH_INTERVAL = 0.001  # s: a long callback may keep the link's thread from running for so long


class BridgeNode(WaamNode):
    """Host end of the link; see docs/interfaces.md. Other machines put another transport behind it."""

    def __init__(self, params: type[CommonParams] = BridgeParams) -> None:
        super().__init__('bridge', params)
        sys.setswitchinterval(SWITCH_INTERVAL)
        p = self.params
        self.core = Bridge(p)
        self._lock = threading.RLock()
        self._crash: Exception | None = None  # of the link's thread
        self._out = Publishers(self, self.core, p.port, self._open_csv(p.csv_log))
        self._create_inputs()
        self.on_change(self._take_params)
        self.create_timer(1.0, self._on_second, clock=self.steady)
        self.transport = self._make_transport()
        self._frames = self._make_frames()
        self.create_timer(FRAMES_S, self._on_frames, clock=self.steady)
        self._stop_lane = self._open_stop_lane(p.stop_socket)
        self.transport.start()

    def _make_transport(self) -> Transport:
        p = self.params
        return SerialTransport(p.port, p.baud, self)

    def _make_frames(self) -> FramePublishers:
        return FramePublishers(self, self.core, Gantry(self.core))

    def _create_inputs(self) -> None:
        self._beats_taken = 0.0  # s, steady clock
        self._beats = Beats(self, self._on_foreign)
        # only tells that there is one: the executor would not say who has published it
        self.create_subscription(Heartbeat, 'heartbeat', self._on_beat, qos.NEWEST)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.EVENTS)
        self.create_subscription(Override, 'override', self._on_override, qos.NEWEST)
        self.create_subscription(
            Override, 'process_override', self._on_process_override, qos.NEWEST
        )
        if self._out.csv:
            self.create_subscription(Temperature, 'temperature', self._on_temperature, qos.SENSOR)
        self._abort = self.create_client(Trigger, 'job_sequencer/abort')
        self._served = Services(self, self.core, self._lock, self._pump, self._at_once)
        self._measures = False  # the controller has an accelerometer, and others can see it

    def _open_csv(self, path: str) -> CsvLog | None:
        if not path:
            return None
        try:
            return CsvLog(open(path, 'w', encoding='utf-8', buffering=1))
        except OSError as e:
            raise ValueError(f"bridge: parameter 'csv_log': {path}: {e.strerror}") from None

    def _open_stop_lane(self, path: str) -> StopLane | None:
        if not path:
            return None
        try:
            return StopLane(path, self._at_once, self._after)
        except OSError as e:
            raise ValueError(f"bridge: parameter 'stop_socket': {path}: {e.strerror}") from None

    def close(self) -> None:
        """A clean end leaves the machine in HOLD instead of running until its watchdog acts."""
        if self._stop_lane:
            self._stop_lane.close()
        with self._lock:
            if self.core.state == frames.RUN:
                self.transport.write(frames.HOLD_NOW)
        self.transport.close()
        self._beats.close()
        if self._out.csv:
            self._out.csv.close()

    # ---- STOP and HOLD past everything, in threads of their own

    def _at_once(self, data: bytes) -> str:
        """Real-time bytes to the controller; '' or why they were not written. Waits for nothing."""
        if data == frames.STOP_NOW:
            self.core.link.sender.blocked = True  # what waits must not be sent any more
        return self.transport.write_now(data)

    def _after(self, order: bytes) -> None:
        """The rest of it: the job ends, then the core does what the command of this name does."""
        try:
            if order == STOP and self._abort.service_is_ready():
                self._abort.call_async(Trigger.Request())
            code = commands.STOP if order == STOP else commands.HOLD
            with self._lock:
                commands.run(self.core, commands.Command(code), lambda *_: None, time.monotonic())
            self._pump()
            self.get_logger().warning('STOP' if order == STOP else 'HOLD')
        except Exception as e:
            self.on_crash(e)

    # ---- called by the transport, in its thread

    def on_open(self) -> None:
        """The port is open: identification of the controller begins."""
        with self._lock:
            self.core.opened(time.monotonic())

    def on_close(self, reason: str) -> None:
        """The port is closed or could not be opened; the reason is logged once, not at every attempt."""
        with self._lock:
            if not self.core.connected and reason != self.core.message:
                self.get_logger().error(f'no controller: {reason}')
            self.core.closed(reason)
            self._out.outbox()

    def on_lines(self, lines: list[bytes], read_at: float) -> None:
        """Hands lines to the core and publishes what follows from each before the next one is read."""
        with self._lock:
            self._align()
            for raw in lines:
                frame = self.core.line(raw, read_at)
                if frame is not None:
                    self._out.frame(frame)
                if self.core.outbox:
                    self._out.outbox()

    def on_idle(self) -> None:
        """Sends what is due; closes the port when the core has given the controller up."""
        if time.monotonic() - self._beats_taken > BEATS_S:
            self._take_beats()
        self._pump()
        if self.core.link.failed:
            self.transport.reopen(self.core.link.failed)

    def on_crash(self, error: Exception) -> None:
        """Publishing fails when the context ends first; anything else ends the node by its next timer."""
        if self.context.ok():
            self._crash = error

    def _align(self) -> None:
        """Keeps the core's ROS time up to date where it needs it; an interrupted reading does not count."""
        link = self.core.link
        if link.clock.synchronised:
            return
        before = time.monotonic()
        ros = self.get_clock().now().nanoseconds
        after = time.monotonic()
        if after - before < ALIGN or not link.ros_offset_ns:
            link.ros_offset_ns = ros - round((before + after) * 5e8)

    def _pump(self) -> None:
        """Writes what is due and publishes what came of it."""
        with self._lock:
            data = self.core.poll(time.monotonic())
            if data:
                written = time.monotonic()
                self.transport.write(data)
                self.core.link.wrote(written)
            if self.core.outbox:
                self._out.outbox()

    def _on_second(self) -> None:
        if self._crash:
            raise self._crash
        with self._lock:
            self._diagnose(self._out.second())
            self._offer()

    def _on_frames(self) -> None:
        if self.context.ok():
            with self._lock:
                self._frames.publish()

    def _offer(self) -> None:
        """The simulated cell has an accelerometer of its own, so this one is offered only where there is one."""
        link = self.core.link
        if self._measures or not link.ready or CAPABILITY not in link.who.capabilities:
            return
        self._measures = True
        self._out.offer_acceleration()
        self._served.offer_accelerometer()

    def _diagnose(self, msg: LinkStatus) -> None:
        core = self.core
        level = ERROR if not core.connected or core.state == frames.ALARM else OK
        self.level = WARN if level == OK and (core.silent or core.state == frames.HOLD) else level
        self.message = core.message
        self.values = diagnostic_values(core, msg, self.params.port)

    # ---- callbacks of the executor

    def _on_tick(self, tick: LeaseTick) -> None:
        """Callbacks that wait are still called once after the context has ended."""
        if self.context.ok():
            super()._on_tick(tick)

    def _publish_diagnostics(self) -> None:
        if self.context.ok():
            super()._publish_diagnostics()

    def _on_beat(self, _: Heartbeat) -> None:
        self._take_beats()

    def _take_beats(self) -> None:
        with self._lock:
            self._beats_taken = time.monotonic()
            for beat, publisher in self._beats.take():
                now = time.monotonic()
                self.core.beat(beat.node, beat.controller_us, beat.boot_id, now, publisher)
            if self.core.link.out:
                self._pump()

    def _on_foreign(self, text: str) -> None:
        self.core.notice(WARNING, 'node', text)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        processes = [v.value for s in msg.status for v in s.values if v.key == PROCESS]
        with self._lock:
            for process in processes:
                self.core.arming.lives.heard(process, time.monotonic())

    def _on_override(self, msg: Override) -> None:
        with self._lock:
            now = time.monotonic()
            overrides.operator(self.core, msg.speed_factor, msg.wire_factor, msg.source, now)
        self._pump()

    def _on_process_override(self, msg: Override) -> None:
        with self._lock:
            now = time.monotonic()
            overrides.process(self.core, msg.speed_factor, msg.wire_factor, msg.source, now)
            due = bool(self.core.link.out)
        if due:
            self._pump()

    def _take_params(self, params: CommonParams) -> None:
        """Other settings of the standoff control. ValueError while a job is armed or the machine runs."""
        with self._lock:
            self.core.standoff.change(params, self.core)

    def _on_temperature(self, msg: Temperature) -> None:
        if self._out.csv:
            self._out.csv.temperature = msg.temperature


def main() -> None:
    node_main(BridgeNode)
