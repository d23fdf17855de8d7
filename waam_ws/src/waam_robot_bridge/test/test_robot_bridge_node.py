"""The bridge and the simulated robot cell as two processes, over real DDS; both with their own messages."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from control_msgs.msg import DynamicInterfaceGroupValues
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState

from waam_msgs.msg import MachineState, SegmentDone, Telemetry
from waam_msgs.srv import Command, Enqueue
from waam_node import qos
from waam_node.conversions import segment_to_msg
from waam_node.testing import fresh_domain
from waam_process.segment import Kind, Segment
from waam_robot.station import Place, Station
from waam_robot_bridge.params import NAMES

TOP = 0.025  # m, of the plate on the table
TILT = 1.2  # rad
ZERO = (0.100, 0.080, 0.020)


def executable(package: str, name: str) -> str:
    return str(Path(get_package_prefix(package)) / 'lib' / package / name)


def until(condition, timeout=60.0, what='condition'):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f'{what}: not reached within {timeout} s'
        time.sleep(0.01)


class Graph:
    """Two processes and a client in a domain of their own. `weld`: (s of controller time, A) as the device tells;
    tilt: rad, of bridge and cell."""

    def __init__(
        self,
        logs: Path,
        cell: bool = True,
        tilt: float = 0.0,
        pace: float = 2.0,
        cell_params: dict[str, str] | None = None,
        **bridge_params: str,
    ) -> None:
        self.domain, self.logs = fresh_domain(), logs
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = rclpy.create_node('robot_test', context=self.context)
        self.telemetry: list[Telemetry] = []
        self.states: list[MachineState] = []
        self.done: list[int] = []
        self.weld: list[tuple[float, float]] = []
        self.joints: dict[str, float] = {}
        subscribe = self.node.create_subscription
        subscribe(Telemetry, 'telemetry', self.telemetry.append, qos.TELEMETRY)
        subscribe(MachineState, 'machine_state', self.states.append, qos.LATCHED)
        subscribe(SegmentDone, 'segment_done', lambda m: self.done.append(m.index), qos.EVENTS)
        subscribe(DynamicInterfaceGroupValues, 'weld_state', self._on_weld, qos.BEAT)
        subscribe(JointState, 'joint_states', self._on_joints, qos.BEAT)
        self._command = self.node.create_client(Command, 'bridge/command')
        self._enqueue = self.node.create_client(Enqueue, 'bridge/enqueue')
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._stop = threading.Event()
        threading.Thread(target=self._spin, daemon=True).start()
        sim = str(cell).lower()
        self.bridge = self._start(
            'waam_robot_bridge', 'robot_bridge', use_sim_time=sim, tilt=f'{tilt}', **bridge_params
        )
        self.processes = [self.bridge]
        if cell:
            own = {'robot_tilt': f'{tilt}', **(cell_params or {})}
            made = self._start(
                'waam_sim', 'robot_cell', use_sim_time='false', pace=f'{pace}', **own
            )
            self.processes.append(made)

    def _start(self, package: str, name: str, **params: str) -> subprocess.Popen:
        args = [a for key, value in params.items() for a in ('-p', f'{key}:={value}')]
        env = {**os.environ, 'ROS_DOMAIN_ID': str(self.domain)}
        env.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        with open(self.logs / f'{name}.log', 'w') as log:
            return subprocess.Popen(
                [executable(package, name), '--ros-args', *args], env=env, stdout=log, stderr=log
            )

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._stop.is_set():
                self._executor.spin_once(timeout_sec=0.05)

    def _on_joints(self, msg: JointState) -> None:
        self.joints.update(zip(msg.name, msg.position, strict=True))

    def _on_weld(self, msg: DynamicInterfaceGroupValues) -> None:
        group = msg.interface_values[0]
        found = dict(zip(group.interface_names, group.values, strict=True))
        stamp = msg.header.stamp
        self.weld.append((stamp.sec + 1e-9 * stamp.nanosec, found['current']))

    @property
    def state(self) -> MachineState:
        return self.states[-1] if self.states else MachineState()

    @property
    def burns(self) -> bool:
        return bool(self.weld) and self.weld[-1][1] > 30.0

    def call(self, client, request):
        until(client.service_is_ready, what='service')
        future = client.call_async(request)
        until(future.done, what='answer')
        return future.result()

    def command(self, code: int, **values) -> None:
        vector = values.pop('vector', None)
        request = Command.Request(code=code, **values)
        if vector:
            request.vector.x, request.vector.y, request.vector.z = vector
        answer = self.call(self._command, request)
        assert answer.error_code == 0, answer.message

    def enqueue(self, segments: list[Segment]) -> Enqueue.Response:
        request = Enqueue.Request(job_id='job', last=True)
        request.segments = [segment_to_msg(s) for s in segments]
        return self.call(self._enqueue, request)

    def log(self, name: str) -> str:
        return (self.logs / f'{name}.log').read_text()

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in self.processes:
            process.wait(15.0)
        self._stop.set()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def graph(tmp_path):
    made = Graph(tmp_path, tilt=TILT)
    yield made
    made.close()


def test_a_bead_on_a_tilted_part_and_an_arc_that_ends_with_the_bridge(graph):
    """Level parts: `test_another_arm_goes_home_in_bridge_and_cell`, and every other job."""
    until(lambda: graph.state.connected, what='connection')
    assert graph.state.limit_max.x == pytest.approx(0.4)
    graph.command(Command.Request.RESET)
    graph.command(Command.Request.HOME)
    until(lambda: graph.state.homed and graph.telemetry[-1].state == 0, what='homing')
    graph.command(Command.Request.SET_ZERO, vector=ZERO)
    graph.command(Command.Request.ARM, text='job', names=['bridge'])
    time.sleep(0.3)
    here = graph.telemetry[-1].position
    over, first, end = (0.03, 0.03, TOP + 0.02), (0.03, 0.03, TOP), (0.10, 0.03, TOP)
    start = (here.x, here.y, here.z)
    source = {'arc': True, 'wire_feed_speed': 0.1, 'voltage': 22.0}
    segments = [
        Segment(0, Kind.IDLE, start, over, 0.15),
        Segment(1, Kind.IDLE, over, first, 0.05),
        Segment(2, Kind.DEPOSIT, first, (0.04, 0.03, TOP), 0.01, **source),
        Segment(3, Kind.DEPOSIT, (0.04, 0.03, TOP), end, 0.01, **source),
    ]
    answer = graph.enqueue(segments)
    assert (answer.error_code, answer.accepted) == (0, 4), answer.message
    assert graph.enqueue(segments).duplicates == 4
    until(lambda: graph.done == [0, 1, 2], what='the first three segments')
    assert graph.burns
    p = graph.telemetry[-1].position
    assert p.x == pytest.approx(0.04, abs=3e-3) and p.y == pytest.approx(0.03, abs=1e-4)
    assert graph.joints['tilt'] == pytest.approx(TILT, abs=1e-4)
    arm = np.array([[graph.joints[name] for name in NAMES]])
    tilted, level = (Station(Place(tilt=t)) for t in (TILT, 0.0))
    here = np.array([p.x, p.y, p.z]) + ZERO
    assert tilted.tips(arm)[0] == pytest.approx(here, abs=3e-3)
    assert np.abs(level.joints(here[None])[0] - arm[0])[:6].max() > 0.05  # another posture
    graph.bridge.kill()
    killed = graph.weld[-1][0]
    until(lambda: not graph.burns, what='the arc to end')
    assert graph.weld[-1][0] - killed <= 0.5
    assert 'Traceback' not in graph.log('robot_cell') + graph.log('robot_bridge')


def test_a_bridge_that_stands_still_for_a_moment_pauses_no_fast_simulation(tmp_path):
    """As on a computer whose cores are busy: at eight times real time half a second is 4 s of the cell."""
    graph = Graph(tmp_path, pace=8.0)
    try:
        until(lambda: graph.state.connected, what='connection')
        graph.command(Command.Request.RESET)
        graph.command(Command.Request.HOME)
        until(lambda: graph.state.homed and graph.telemetry[-1].state == 0, what='homing')
        graph.command(Command.Request.SET_ZERO, vector=ZERO)
        here = graph.telemetry[-1].position
        first, end = (0.03, 0.03, TOP + 0.02), (0.13, 0.03, TOP + 0.02)
        segments = [
            Segment(0, Kind.IDLE, (here.x, here.y, here.z), first, 0.15),
            Segment(1, Kind.IDLE, first, end, 0.01),
            Segment(2, Kind.IDLE, end, first, 0.01),
        ]
        assert graph.enqueue(segments).error_code == 0
        until(lambda: 0 in graph.done, what='the first segment')
        for process in (graph.bridge, graph.processes[1], graph.bridge):
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.6)
            process.send_signal(signal.SIGCONT)
            time.sleep(0.2)
        until(lambda: 2 in graph.done, what='the last segment')
        assert not [s.message for s in graph.states if 'cut' in s.message]
        assert 'arc is cut' not in graph.log('robot_bridge')
    finally:
        graph.close()


def test_wrong_joint_names_are_named_before_anything_moves(tmp_path):
    names = '[joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,tilt,rotate]'
    graph = Graph(tmp_path, cell=False, joint_names=names)
    joints = graph.node.create_publisher(JointState, 'joint_states', qos.BEAT)
    message = JointState(name=list(NAMES), position=[0.0] * 8)
    graph.node.create_timer(0.05, lambda: joints.publish(message))
    try:
        until(lambda: "joint_states has no 'rotate'" in graph.state.message, what='the error')
        assert not graph.state.connected
    finally:
        graph.close()


SMALL_ARM = Path(get_package_share_directory('waam_sim')) / 'urdf' / 'small_arm.urdf'
POSTURE = '[0.0, 0.46, 0.40, 0.0, 1.09, 3.14]'
ARM = {
    'urdf': str(SMALL_ARM), 'posture': POSTURE,
    'joint_names': '[base,shoulder,elbow,wrist_roll,wrist_bend,wrist_turn]',
    'joint_speed_max': '[3.1,2.9,3.6,6.4,6.1,8.5]',
    'joint_acceleration_max': '[7.8,7.3,9.0,16.0,15.0,21.0]',
    'joint_jerk_max': '[78.0,73.0,90.0,160.0,150.0,210.0]',
}  # fmt: skip


def test_another_arm_goes_home_in_bridge_and_cell(tmp_path):
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    cell = {'robot_urdf': str(SMALL_ARM), 'robot_posture': POSTURE}
    graph = Graph(tmp_path, cell_params=cell, **ARM)
    try:
        until(lambda: graph.state.connected, what='connection')
        graph.command(Command.Request.RESET)
        graph.command(Command.Request.HOME)
        until(lambda: graph.state.homed and graph.telemetry[-1].state == 0, what='homing')
        p = graph.telemetry[-1].position
        assert (p.x, p.y, p.z) == pytest.approx((0.0, 0.0, 0.2), abs=2e-3)
        assert set(graph.joints) == set(ARM['joint_names'][1:-1].split(','))
    finally:
        graph.close()


def test_a_urdf_that_cannot_be_used_ends_bridge_and_cell_with_the_reason(tmp_path):
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    names = ARM['joint_names'].replace('wrist_bend', 'joint_9')
    bad = tmp_path / 'bad.urdf'
    bad.write_text(SMALL_ARM.read_text().replace('"elbow" type="revolute"', '"elbow" type="fixed"'))
    graph = Graph(
        tmp_path,
        cell_params={'robot_urdf': str(bad), 'robot_posture': POSTURE},
        **{**ARM, 'joint_names': names},
    )
    try:
        assert [p.wait(60.0) for p in graph.processes] == [2, 2]
        said = f"error: parameter 'urdf': {SMALL_ARM}: no joint 'joint_9' that moves; there are base, shoulder, "
        assert said in graph.log('robot_bridge')
        said = (
            f"error: parameter 'robot_urdf': {bad}: 5 revolute joints move the link 'torch' and 0 "
        )
        assert said in graph.log('robot_cell')
    finally:
        graph.close()
