"""Goals and welding values as messages: what one side writes the other reads; what is wrong is named."""

from __future__ import annotations

from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_process.plant_port import SAMPLE
from waam_robot_bridge import conversions as convert
from waam_robot_bridge import node_driver
from waam_robot_bridge.controller import JointState
from waam_robot_bridge.goals import Goal
from waam_robot_bridge.params import NAMES
from waam_sim.node_trajectory import trajectory_from_msg


def goal(seed: int = 1, points: int = 5, start_us: int = 1_750_000_000_123_456) -> Goal:
    rng = np.random.default_rng(seed)
    joints, rates = rng.uniform(-3, 3, (2, points, 8))
    rates[-1] = 0.0
    return Goal(start_us, np.arange(points) * 0.01, np.zeros((points, 3)), joints, rates)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 30), st.integers(0, 2**50), st.permutations(NAMES))
def test_a_goal_arrives_in_any_order_of_joints(seed, points, start_us, names):
    sent = goal(seed, points, start_us)
    order = [NAMES.index(name) for name in names]
    shuffled = Goal(start_us, sent.time, sent.tips, sent.joints[:, order], sent.rates[:, order])
    got = trajectory_from_msg(convert.goal_to_msg(shuffled, names))
    assert got.start_us == start_us
    assert np.allclose(got.time, sent.time, atol=1e-9)
    assert np.array_equal(got.joints, sent.joints) and np.array_equal(got.rates, sent.rates)


def spoilt(how: str) -> FollowJointTrajectory.Goal:
    msg = convert.goal_to_msg(goal(), NAMES)
    trajectory = msg.trajectory
    if how == 'name':
        trajectory.joint_names[3] = 'joint_9'
    elif how == 'empty':
        trajectory.points = []
    elif how == 'velocity':
        trajectory.points[2].velocities = []
    elif how == 'nan':
        trajectory.points[2].positions[4] = float('nan')
    elif how == 'time':
        trajectory.points[3].time_from_start = trajectory.points[2].time_from_start
    return msg


@pytest.mark.parametrize(
    ('how', 'said'),
    [
        ('name', 'joint_4, joint_9'),
        ('empty', 'no points'),
        ('velocity', 'one velocity'),
        ('nan', 'finite'),
        ('time', 'times have to rise'),
    ],
)
def test_a_bad_goal_is_refused_with_the_reason(how, said):
    with pytest.raises(ValueError, match=said):
        trajectory_from_msg(spoilt(how))


def test_outputs_name_their_values():
    sample = np.zeros(1, SAMPLE)
    sample['outputs'], sample['wire_cmd'], sample['voltage_set'] = 3, 0.1, 22.5
    msg = convert.outputs_to_msg(sample[0], 1_000_001)
    group = msg.interface_values[0]
    found = dict(zip(group.interface_names, group.values, strict=True))
    assert found == {'arc': 1.0, 'gas': 1.0, 'wire_feed_speed': 0.1, 'voltage': 22.5}
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (1, 1000)


def test_inputs_need_every_value():
    one = InterfaceValue(
        interface_names=['gas_ok', 'current', 'voltage'], values=[1.0, 180.0, 22.0]
    )
    msg = DynamicInterfaceGroupValues(interface_groups=['welding'], interface_values=[one])
    with pytest.raises(ValueError, match="no value 'wire_speed'"):
        convert.inputs_from_msg(msg)
    one.interface_names.append('wire_speed')
    one.values.append(0.1)
    msg.interface_values = [one]
    reading = convert.inputs_from_msg(msg)
    assert (reading.inputs, reading.current) == (convert.GAS_OK, 180.0)
    msg.interface_groups = ['gripper']
    with pytest.raises(ValueError, match="no group 'welding'"):
        convert.inputs_from_msg(msg)


@pytest.mark.parametrize(
    ('steady', 'ros', 'silent'),
    [(0.2, 0.2, False), (0.4, 0.4, True), (1.0, 0.0, False), (0.1, 9.0, False), (2.5, 0.0, True)],
)
def test_a_welding_device_is_silent_when_both_clocks_say_so(monkeypatch, steady, ros, silent):
    """A simulated cell that stands still is not; one that stands for long is."""
    now = SimpleNamespace(nanoseconds=10**9)
    clock = SimpleNamespace(now=lambda: now)
    node = SimpleNamespace(
        get_clock=lambda: clock,
        create_publisher=lambda *a: None,
        create_subscription=lambda *a: None,
    )
    monkeypatch.setattr(node_driver, 'time', SimpleNamespace(monotonic=lambda: wall[0]))
    wall = [50.0]
    welder = node_driver.RosWelder(node)  # type: ignore[arg-type]
    assert 'nothing on topic' in welder.problem()
    reading = InterfaceValue(interface_names=['gas_ok', 'current', 'voltage', 'wire_speed'])
    reading.values = [1.0, 100.0, 20.0, 0.1]
    welder._on_state(
        DynamicInterfaceGroupValues(interface_groups=['welding'], interface_values=[reading])
    )
    wall[0] += steady
    now.nanoseconds += int(ros * 1e9)
    assert ('silent' in welder.problem()) == silent


def test_lost_joint_states_are_made_up_for_where_later_ones_are_there():
    driver = object.__new__(node_driver.RosDriver)
    at = lambda ms: JointState(ms * 1000, np.full(8, ms * 1e-3), np.full(8, 1.0))  # noqa: E731
    driver._states = deque([at(100), at(110), at(300), at(310)])
    assert driver.state(95_000).time_us == 100_000  # the oldest that is known
    assert [driver.state(ms * 1000).time_us for ms in (105, 120, 305, 900)] == [
        100_000,
        110_000,
        300_000,
        310_000,
    ]
    made = driver.state(205_000)
    assert made.time_us == 205_000 and made.joints == pytest.approx(np.full(8, 0.205))
    driver._states.clear()
    assert driver.state(100_000) is None
