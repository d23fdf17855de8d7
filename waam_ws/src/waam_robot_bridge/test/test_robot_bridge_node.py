"""The bridge and the simulated robot cell as two processes, over real DDS; both with their own messages."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory
from bridge_graph import Graph, until
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from waam_bridge.frame_tree import Placed, in_root
from waam_msgs.srv import Command
from waam_node import qos
from waam_process.segment import Kind, Segment
from waam_robot.station import Place, Station
from waam_robot_bridge.params import NAMES

TOP = 0.025  # m, of the plate on the table
TILT = 1.2  # rad
ZERO = (0.100, 0.080, 0.020)


@pytest.fixture
def graph(tmp_path):
    made = Graph(tmp_path, tilt=TILT)
    yield made
    made.close()


def seen_from_work(graph):
    """(3,) m: the wire tip by the tree on /tf and /tf_static, of a machine at rest; one root, no frame twice."""
    got = {'/tf': [], '/tf_static': []}
    graph.node.create_subscription(TFMessage, '/tf', got['/tf'].append, qos.EVENTS)
    graph.node.create_subscription(TFMessage, '/tf_static', got['/tf_static'].append, qos.LATCHED)
    until(lambda: all(got.values()), what='frames')
    found = []
    for t in (t for messages in got.values() for t in messages[-1].transforms):
        p, q = t.transform.translation, t.transform.rotation
        at, turned = (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)
        found.append(Placed(t.header.frame_id, t.child_frame_id, at, turned))
    children = [p.child for p in found]
    assert len(children) == len(set(children))
    assert {p.parent for p in found} - set(children) == {'world'}
    return (np.linalg.inv(in_root(found, 'work')) @ in_root(found, 'torch_tcp'))[:3, 3]


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
    assert seen_from_work(graph) == pytest.approx([here.x, here.y, here.z], abs=1e-3)
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


def test_an_arm_far_outside_its_box_is_told_and_not_moved(tmp_path):
    """The bridge has machine zero 150 mm lower than the cell."""
    graph = Graph(tmp_path, origin='[-0.2,-0.15,-0.15]')
    try:
        until(lambda: 'outside its box' in graph.state.message, what='the error')
        assert 'the torch stands at (60, 50, 300) mm of the machine, 100 mm' in graph.state.message
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
