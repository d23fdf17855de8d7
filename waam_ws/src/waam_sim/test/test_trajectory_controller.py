"""The trajectory controller of the simulated robot keeps the rules of a stock one; the figures in the cases are of its
documentation and of its source (ros2_controllers 4.42)."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus, GoalStatusArray
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance, JointTrajectoryControllerState, SpeedScalingFactor
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from trajectory_msgs.msg import JointTrajectoryPoint

from waam_node.conversions import stamp_ns
from waam_node.testing import fresh_domain
from waam_sim import node_trajectory
from waam_sim import trajectory_rules as rules
from waam_sim.node_trajectory import ACTION, CONTROLLER, TrajectoryController
from waam_sim.robot import Trajectory
from waam_sim.trajectory_rules import ToleranceError, Tolerances

NAMES = ('a', 'b')
NOW = 1_750_000_000_000_000  # us
STANDS = np.zeros(2)


def line(start_us: int = NOW, seconds: float = 1.0, way: float = 1.0) -> Trajectory:
    """Joint a goes `way` rad, from rest to rest."""
    return Trajectory(
        start_us, np.array([0.0, seconds]), np.array([[0.0, 0.0], [way, 0.0]]), np.zeros((2, 2))
    )


@pytest.mark.parametrize(
    'at_us,speed,said',
    [
        (NOW + 1_000_000, 0.0, ''),
        (NOW + 1_001_000, 0.0, 'ended 0.001 s ago'),
        (NOW, 0.1, 'still moves at its end'),
    ],
)
def test_what_is_over_or_does_not_end_at_rest_is_refused(at_us, speed, said):
    t = line()
    t.rates[-1] = speed
    assert said in rules.refusal(t, at_us) and bool(said) == bool(rules.refusal(t, at_us))
    assert not rules.refusal(line(0), at_us)  # without a start it begins when it comes


def test_a_goal_of_the_future_forgets_the_one_before_and_begins_where_the_axes_are():
    at, speed = np.array([0.5, 0.25]), np.array([0.1, 0.0])
    made = rules.begun(line(NOW + 50_000), NOW, at, speed)
    assert made.at(np.array([NOW]))[0] == pytest.approx(at)
    assert made.at(np.array([NOW + 50_000]))[0] == pytest.approx([0.0, 0.0])
    past = rules.begun(line(NOW - 50_000), NOW, at, speed)
    assert past.at(np.array([NOW]))[0] == pytest.approx(line().at(np.array([NOW + 50_000]))[0])
    now = rules.begun(line(0), NOW, at, speed)
    assert now.at(np.array([NOW + 1_000_000]))[0] == pytest.approx([1.0, 0.0])


def test_tolerances_of_a_goal_go_before_the_usual_ones():
    usual = Tolerances.usual(2)
    one = SimpleNamespace(name='b', position=0.1, velocity=0.0)
    none = SimpleNamespace(name='a', position=0.0, velocity=-1.0)
    made = usual.of_goal([one], [none], 0.5, NAMES)
    assert made.path.tolist() == [[0.0, 0.1], [0.0, 0.0]]
    assert made.end.tolist() == [[0.0, 0.0], [0.0, 0.01]] and made.late == 0.5
    one.position = -0.5
    with pytest.raises(ToleranceError, match='-0.5 for b'):
        usual.of_goal([one], [], 0.0, NAMES)
    one.name = 'c'
    with pytest.raises(ToleranceError, match="no joint 'c'"):
        usual.of_goal([], [one], 0.0, NAMES)


def test_a_goal_ends_when_the_axes_stand_at_its_end_or_are_too_far_or_too_late():
    t, usual = line(), Tolerances.usual(2)
    path = np.array([[0.1, 0.0], [0.0, 0.0]])
    close = Tolerances(path, usual.end + [[0.05, 0.0], [0.0, 0.0]], 0.2)
    middle, end = NOW + 500_000, NOW + 1_000_000
    off = np.array([0.5 + 0.11, 0.0])
    assert rules.end_of(t, usual, middle, off, STANDS) is None
    assert rules.end_of(t, close, middle, off - [0.02, 0.0], STANDS) is None
    assert rules.end_of(t, close, middle, off, STANDS) == (-4, rules.OFF_PATH)
    arrived, moving = np.array([1.0, 0.0]), np.array([0.02, 0.0])
    assert rules.end_of(t, usual, end, arrived, moving) is None
    assert rules.end_of(t, usual, end, arrived, STANDS) == (0, rules.REACHED)
    assert rules.end_of(t, usual, end + 9_000_000, arrived, moving) is None  # goal_time 0
    assert rules.end_of(t, close, end + 100_000, arrived - 0.06, STANDS) is None
    late = rules.end_of(t, close, end + 250_000, arrived - 0.06, STANDS)
    assert late == (-5, 'Aborted due to goal_time_tolerance exceeding by 0.250000 seconds')


class Arm:
    """Axes that are where the newest goal has them; `stuck`: but for 0.2 rad. Time is told."""

    def __init__(self) -> None:
        self.speed_scale, self.behind_us = 1.0, 0
        self.now, self.stuck = NOW, 0.0
        self.goal: Trajectory | None = None

    def follow(self, *goal) -> None:
        self.goal = Trajectory(*goal)

    def state(self):
        at = np.zeros(2)
        if self.goal:
            at = self.goal.at(np.array([self.now - self.behind_us]))[0]
        return self.now, at + self.stuck, np.zeros(2)

    def beyond(self, joints) -> str:
        return ''


class Bench:
    """A controller before an Arm, and its client."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=fresh_domain())
        self.node = rclpy.create_node('robot', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.arm = Arm()
        self.controller = TrajectoryController(
            self.node, threading.Lock(), self.arm, NAMES, lambda: self.arm.now
        )
        self.client = ActionClient(self.node, FollowJointTrajectory, ACTION)
        self.until(self.client.server_is_ready)

    def until(self, condition) -> None:
        end = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.05)

    def done(self, future):
        self.until(future.done)
        return future.result()

    def send(self, t: Trajectory, **tolerances):
        goal = FollowJointTrajectory.Goal(**tolerances)
        goal.trajectory.joint_names = list(NAMES)
        goal.trajectory.header.stamp = stamp_ns(1000 * t.start_us)
        for at, joints, rates in zip(t.time, t.joints, t.rates, strict=True):
            point = JointTrajectoryPoint(positions=joints.tolist(), velocities=rates.tolist())
            point.time_from_start = Duration(sec=int(at), nanosec=int(at % 1 * 1e9))
            goal.trajectory.points.append(point)
        handle = self.done(self.client.send_goal_async(goal))
        return handle, handle.get_result_async() if handle.accepted else None

    def tell(self, later_us: int) -> None:
        self.arm.now += later_us
        self.arm.behind_us += round((1 - self.arm.speed_scale) * later_us)
        self.controller.tell(*self.arm.state())

    def close(self) -> None:
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.close()


def told(result) -> tuple[int, int, str]:
    return result.status, result.result.error_code, result.result.error_string


def test_goals_end_succeeded_preempted_cancelled_and_beyond_tolerance(bench):
    handle, result = bench.send(line())
    bench.tell(500_000)
    assert handle.accepted and not result.done()
    later, second = bench.send(line(bench.arm.now))
    assert told(bench.done(result)) == (GoalStatus.STATUS_ABORTED, -1, rules.PREEMPTED)
    bench.tell(1_100_000)
    assert told(bench.done(second)) == (GoalStatus.STATUS_SUCCEEDED, 0, rules.REACHED)
    refused, _ = bench.send(line(bench.arm.now - 1_100_000))
    assert not refused.accepted

    handle, result = bench.send(line(bench.arm.now))
    bench.tell(300_000)
    where = bench.arm.state()[1].copy()
    bench.done(handle.cancel_goal_async())
    assert bench.done(result).status == GoalStatus.STATUS_CANCELED
    bench.tell(300_000)
    assert bench.arm.state()[1] == pytest.approx(where) and 0.1 < where[0] < 0.9

    tight = [JointTolerance(name='a', position=0.1)]
    _, result = bench.send(line(bench.arm.now), path_tolerance=tight)
    bench.arm.stuck = 0.2
    bench.tell(300_000)
    assert told(bench.done(result)) == (GoalStatus.STATUS_ABORTED, -4, rules.OFF_PATH)


def test_speed_scaling_slows_a_goal_down_and_is_told(bench):
    states: list[JointTrajectoryControllerState] = []
    state, scaling = f'{CONTROLLER}/controller_state', f'{CONTROLLER}/speed_scaling_input'
    bench.node.create_subscription(JointTrajectoryControllerState, state, states.append, 10)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    pendant = bench.node.create_publisher(SpeedScalingFactor, scaling, latched)
    pendant.publish(SpeedScalingFactor(factor=0.5))
    bench.until(lambda: bench.arm.speed_scale == 0.5)
    pendant.publish(SpeedScalingFactor(factor=-1.0))  # means nothing
    _, result = bench.send(line())
    bench.until(lambda: bench.node.count_subscribers(state))
    bench.tell(1_000_000)
    bench.until(lambda: states)
    assert (states[-1].speed_scaling_factor, bench.arm.speed_scale) == (0.5, 0.5)
    assert states[-1].reference.positions[0] == pytest.approx(0.5)
    assert not result.done()
    bench.tell(1_000_001)
    assert bench.done(result).result.error_code == 0


def test_states_of_goals_that_have_ended_are_not_told_for_ever(monkeypatch):
    """With every goal the states of all that are kept go out: those of minutes took most of the bridge's time."""
    monkeypatch.setattr(node_trajectory, 'RESULT_KEPT_S', 1)
    bench = Bench()
    lengths: list[int] = []
    bench.node.create_subscription(
        GoalStatusArray,
        f'{ACTION}/_action/status',
        lambda m: lengths.append(len(m.status_list)),
        10,
    )
    try:
        for _ in range(6):
            _, result = bench.send(line(bench.arm.now))
            bench.tell(1_100_000)
            bench.done(result)
        bench.until(lambda: max(lengths, default=0) >= 5)
        over = time.monotonic() + 2.5
        bench.until(lambda: time.monotonic() > over)
        lengths.clear()
        bench.send(line(bench.arm.now))
        bench.until(lambda: lengths)
        assert max(lengths) == 1
    finally:
        bench.close()
