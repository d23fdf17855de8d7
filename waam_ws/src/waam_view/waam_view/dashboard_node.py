"""Shows the cell live in rerun, keeps job.rrd of every job and writes its report. Callbacks only hand over; threads
do the work."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from waam_msgs.msg import HeightMap, JobStatus, MachineState, Telemetry
from waam_node import cdr
from waam_node.conversions import nanoseconds
from waam_node.node import OK, WARN, WaamNode
from waam_node.node import main as run_main
from waam_node.params import param
from waam_node.qos import EVENTS, LATCHED, SENSOR
from waam_process.names import job_state
from waam_robot.urdf_text import UrdfError

from . import conversions as cv
from .drawing import Drawing
from .node_layers import LayerTopics
from .node_tap import TelemetryTap
from .report_writer import ReportWriter
from .robot_scene import RobotScene
from .scene import Scene

QOS = {'temperature': SENSOR, 'layer_report': EVENTS, 'anomaly': EVENTS}  # all others are latched
WINDOW_S = 120.0  # of ROS time that live plots show
NICE = 10  # where cores are scarce the nodes of the loop come first


@dataclass(frozen=True)
class DashboardParams:
    """Parameters of the node, with default, meaning, unit and limits."""

    grpc_port: int = param(9876, 'rerun server on 127.0.0.1; 0 = none', '', 0, 65535)
    web_port: int = param(0, 'web viewer on 127.0.0.1; 0 = none', '', 0, 65535)
    memory_mb: int = param(
        96, 'what the server keeps for viewers that connect late', 'MB', 16, 65536
    )
    telemetry_period: float = param(
        0.1, 'ROS time between two telemetry frames shown', 's', 0.0, 10.0
    )
    error_range: float = param(
        0.0006, 'height error at the ends of the colour scale', 'm', 1e-5, 0.1
    )
    record: bool = param(True, 'keep job.rrd in the folder of the job')
    report: bool = param(True, 'write report.html when a job has ended')
    robot_joints: tuple = param(
        ('joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6', 'tilt', 'turn'),
        'of joint_states, for the picture of the robot: six of the arm, tilt, turn',
    )
    robot_positioner: tuple = param(
        (1.2, 0.35, 0.15), 'for the picture of the robot: `positioner` of the robot bridge', 'm'
    )
    robot_origin: tuple = param(
        (-0.2, -0.15, 0.0), 'for the picture of the robot: `origin` of the robot bridge', 'm'
    )
    robot_urdf: str = param(
        '',
        'for the picture of the robot: `urdf` of the robot bridge; then `robot_joints` are the names of its joints, '
        'and `robot_positioner` means nothing',
    )


class Dashboard(WaamNode):
    """Not required by the arc lease; draws in a thread of its own."""

    def __init__(self) -> None:
        super().__init__('dashboard', DashboardParams)
        p = self.params
        self._drawing = Drawing(
            Scene(p.error_range), p.grpc_port, p.web_port, p.memory_mb, WINDOW_S
        )
        log = self.get_logger()
        self._reports = ReportWriter(log.info, log.warning) if p.report else None
        self._job = ''
        self._messages = cv.MessageDrawing()
        self._next_ns = 0
        self._tap = TelemetryTap(self, '_dashboard_tap')
        self.create_timer(0.02, self._poll_telemetry, clock=self.steady)
        self.create_timer(1.0, self._report, clock=self.steady)
        for topic, kind in cv.TYPES.items():
            qos = QOS.get(topic, LATCHED)
            self.create_subscription(kind, topic, partial(self._on_message, topic), qos)
        self._layers = LayerTopics(self)
        self._joints: dict[str, float] = {}
        self._work_zero = (0.0, 0.0, 0.0)
        self._robot_next_ns, self._robot_text = 0, ''
        self._robot = self._arm()
        if self._robot is not None:
            self.create_subscription(JointState, 'joint_states', self._on_joints, SENSOR, raw=True)

    def _arm(self) -> RobotScene | None:
        """None for a URDF that cannot be used: the rest is shown all the same."""
        p = self.params
        try:
            text = Path(p.robot_urdf).read_bytes() if p.robot_urdf else b''
            return RobotScene(p.robot_joints, p.robot_positioner, p.robot_origin, text)
        except (OSError, UrdfError) as e:
            self._robot_text = f"not shown: parameter 'robot_urdf': {p.robot_urdf}: {e}"
            self.get_logger().warning(f'robot {self._robot_text}')
            return None

    def _poll_telemetry(self) -> None:
        """Decodes one frame per period."""
        period = int(self.params.telemetry_period * 1e9)
        for raw in self._tap.take():
            t = cdr.stamp_ns(raw)
            if t >= self._next_ns or t < self._next_ns - 2 * period:
                self._next_ns = t + period
                self._drawing.telemetry(cv.sample(deserialize_message(raw, Telemetry)))

    def _on_joints(self, raw: bytes) -> None:
        """One state per period; arm and positioner may tell theirs apart, then the period begins with the last one."""
        period = int(self.params.telemetry_period * 1e9)
        t = cdr.stamp_ns(raw)
        if self._robot_next_ns - 2 * period <= t < self._robot_next_ns:
            return
        msg = deserialize_message(raw, JointState)
        self._joints.update(zip(msg.name, msg.position, strict=False))
        robot = self._robot
        assert robot is not None  # subscribed then
        missing = robot.missing(self._joints)
        if missing:
            self._robot_text = f"not shown: joint_states has no '{missing}'"
            return
        self._robot_text, self._robot_next_ns = 'shown', t + period
        known, zero = self._joints, self._work_zero
        self._joints = {}
        self._drawing.newest('robot', lambda scene: robot.draw(scene, t, known, zero))

    def _on_message(self, topic: str, msg: Any) -> None:
        if topic == 'job_status':
            self._begin_job(msg)
        draw = self._messages.of(topic, msg)
        if topic in cv.NEWEST:
            self._drawing.newest(topic, draw)
        else:
            self._drawing.put(draw)
        match msg:
            case HeightMap():
                self._drawing.expect_error(msg.layer, lambda: cv.map_data(msg))
            case MachineState():
                self._work_zero = (msg.work_offset.x, msg.work_offset.y, msg.work_offset.z)
            case JobStatus():
                self._end_job(msg)

    def _begin_job(self, msg: JobStatus) -> None:
        running = msg.state != JobStatus.IDLE and msg.state not in cv.ENDED
        if msg.job_dir and msg.job_dir != self._job and running:
            self._job = msg.job_dir
            self._drawing.start_job(Path(msg.job_dir), self.params.record)
            if self._reports:
                self._reports.begin(Path(msg.job_dir))

    def _end_job(self, msg: JobStatus) -> None:
        if msg.state not in cv.ENDED:
            return
        if msg.job_dir and self._reports:
            self._reports.end(Path(msg.job_dir))
        if msg.job_dir == self._job:
            self._job = ''
            t, said = nanoseconds(msg.header.stamp), f'job {job_state(msg.state).lower()}'
            self._drawing.put(lambda scene: scene.text(t, 0, f'{said}: {msg.message}'))
            self._drawing.end_job()

    def _report(self) -> None:
        drawing = self._drawing
        self.values = {
            'viewer': drawing.url, 'file': drawing.file, 'drawn': drawing.drawn,
            'dropped': drawing.mailbox.dropped, 'maps_skipped': drawing.mailbox.replaced,
            'longest_draw_ms': f'{drawing.longest_s * 1e3:.0f}',
        }  # fmt: skip
        if self._robot_text:
            self.values['robot'] = self._robot_text
        problem = drawing.problem
        if self._reports:
            problem = problem or self._reports.problem
            self.values['report'] = self._reports.last
        self.level = WARN if problem or drawing.mailbox.dropped else OK
        self.message = problem or 'ok'

    def close(self) -> None:
        """Finishes report and drawing, each within a bounded time."""
        if self._reports:
            self._reports.close()
        self._drawing.close()
        self._tap.close()


def main() -> None:
    """The node as a process, at a lower priority (NICE) than the ones that control the cell."""
    os.nice(NICE)
    run_main(Dashboard)
