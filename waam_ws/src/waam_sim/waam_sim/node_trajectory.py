"""A simulated trajectory controller of a robot: an action server by the rules of ros2_control's."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState, SpeedScalingFactor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from waam_node import qos
from waam_node.conversions import stamp_ns

from . import trajectory_rules as rules
from .robot import Trajectory
from .trajectory_rules import ToleranceError, Tolerances

NAMES = ('joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6', 'tilt', 'turn')
CONTROLLER = 'joint_trajectory_controller'
ACTION = f'{CONTROLLER}/follow_joint_trajectory'
# s that the end of a goal can be asked for, as with controllers in C++: with every goal the states of all that are kept
# go out, and rclpy's own 15 minutes of them cost the bridge most of its time.
RESULT_KEPT_S = 10


class Axes(Protocol):
    """What moves: (n,) or (N, n) rad, rad/s."""

    speed_scale: float  # seconds of a trajectory that pass in a second
    behind_us: int  # of the trajectory under way, by what it was slowed down

    def follow(
        self, start_us: int, time: np.ndarray, joints: np.ndarray, rates: np.ndarray
    ) -> None:
        """Replaces what they do."""

    def state(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Time (us), joints, rates."""

    def beyond(self, joints: np.ndarray) -> str:
        """Which of (N, n) is beyond its limit, '' = none."""


class Active(NamedTuple):
    """The goal that is followed."""

    handle: Any
    trajectory: Trajectory
    limits: Tolerances


def trajectory_from_msg(
    msg: FollowJointTrajectory.Goal, names: Sequence[str] = NAMES
) -> Trajectory:
    """Joints in the order of `names`; a start of 0 means now. ValueError says what is wrong."""
    t = msg.trajectory
    if sorted(t.joint_names) != sorted(names):
        wrong = sorted(set(t.joint_names) ^ set(names))
        raise ValueError(f'the joints differ from those of the robot: {", ".join(wrong)}')
    if not t.points:
        raise ValueError('it has no points')
    if any(len(p.positions) != len(names) or len(p.velocities) != len(names) for p in t.points):
        raise ValueError('a point has not one position and one velocity for every joint')
    if any(p.effort for p in t.points):
        raise ValueError('a point has efforts, the drives take positions')
    order = [list(t.joint_names).index(name) for name in names]
    time = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in t.points])
    joints = np.array([p.positions for p in t.points])[:, order]
    rates = np.array([p.velocities for p in t.points])[:, order]
    if not (np.isfinite(joints).all() and np.isfinite(rates).all()) or (np.diff(time) <= 0).any():
        raise ValueError('values have to be finite and times have to rise')
    start = t.header.stamp
    return Trajectory(start.sec * 1_000_000 + start.nanosec // 1000, time, joints, rates)


class TrajectoryController:
    """Action server, joint states, `controller_state` while somebody listens, `speed_scaling_input`.

    Hands good goals to `axes` (under `lock`), refuses others and says why in the log. Beyond the rules of the stock one
    it wants a speed at every point, and a goal's status stays ACCEPTED until it ends; it tells no feedback. A goal is
    taken before it is accepted, so that time can wait for it (`waam_robot_bridge.node_transport`). now_us: time of the
    robot.
    """

    def __init__(
        self,
        node: Node,
        lock: threading.Lock,
        axes: Axes,
        names: Sequence[str] = NAMES,
        now_us: Callable[[], int] = lambda: 0,
        **server: Any,
    ) -> None:
        self._node, self._lock, self._axes = node, lock, axes
        self._names, self._now_us = names, now_us
        self._usual = Tolerances.usual(len(names))
        self._taken: dict[int, tuple[Trajectory, Tolerances]] = {}  # by the request
        self._active: Active | None = None
        self._ending = threading.Lock()  # of the active goal
        self._states = node.create_publisher(JointState, 'joint_states', qos.BEAT)
        state = f'{CONTROLLER}/controller_state'
        self._told = node.create_publisher(JointTrajectoryControllerState, state, qos.EVENTS)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        scaling = f'{CONTROLLER}/speed_scaling_input'
        node.create_subscription(SpeedScalingFactor, scaling, self._on_scaling, latched, **server)
        self._server = ActionServer(
            node,
            FollowJointTrajectory,
            ACTION,
            execute_callback=lambda handle: None,  # of no goal: `_end` says how it ends
            goal_callback=self._judge,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT_S,
            **server,
        )

    def tell(self, time_us: int, joints: np.ndarray, rates: np.ndarray) -> None:
        """Publishes the state of the axes, and ends the goal that has ended."""
        msg = JointState(name=list(self._names), position=joints.tolist(), velocity=rates.tolist())
        msg.header.stamp = stamp_ns(1000 * time_us)
        self._states.publish(msg)
        active = self._active
        at_us = time_us - self._axes.behind_us
        if self._told.get_subscription_count():
            self._tell_state(msg, active, at_us)
        ended = active and rules.end_of(active.trajectory, active.limits, at_us, joints, rates)
        if ended and self._end(*ended, active) and ended[0] != rules.SUCCESSFUL:
            self._stop()

    def _tell_state(self, now: JointState, active: Active | None, at_us: int) -> None:
        msg = JointTrajectoryControllerState(header=now.header, joint_names=now.name)
        msg.speed_scaling_factor = self._axes.speed_scale
        msg.feedback = JointTrajectoryPoint(positions=now.position, velocities=now.velocity)
        if active:
            wanted = active.trajectory.at(np.array([at_us]))[0]
            msg.reference = msg.output = JointTrajectoryPoint(positions=wanted.tolist())
            msg.error = JointTrajectoryPoint(positions=(wanted - np.array(now.position)).tolist())
        self._told.publish(msg)

    def _judge(self, goal: FollowJointTrajectory.Goal) -> GoalResponse:
        try:
            given = trajectory_from_msg(goal, self._names)
            said = rules.refusal(given, self._now_us()) or self._axes.beyond(given.joints)
        except ValueError as e:
            said = str(e)
        if said:
            self._node.get_logger().error(f'goal refused: {said}')
            return GoalResponse.REJECT
        with self._lock:
            trajectory = rules.begun(given, *self._axes.state())
            self._follow(trajectory)
        self._taken[id(goal)] = trajectory, self._limits(goal)
        return GoalResponse.ACCEPT

    def _limits(self, goal: FollowJointTrajectory.Goal) -> Tolerances:
        late = goal.goal_time_tolerance.sec + 1e-9 * goal.goal_time_tolerance.nanosec
        try:
            return self._usual.of_goal(goal.path_tolerance, goal.goal_tolerance, late, self._names)
        except ToleranceError as e:
            self._node.get_logger().error(f'tolerances of a goal: {e}; the usual ones are taken')
            return self._usual

    def _follow(self, t: Trajectory) -> None:
        self._axes.follow(t.start_us, t.time, t.joints, t.rates)

    def _stop(self) -> None:
        """Where the axes are."""
        with self._lock:
            self._follow(rules.standing(self._now_us(), self._axes.state()[1]))

    def _on_accepted(self, handle: Any) -> None:
        self._end(rules.INVALID_GOAL, rules.PREEMPTED)
        self._active = Active(handle, *self._taken.pop(id(handle.request)))

    def _on_cancel(self, handle: Any) -> CancelResponse:
        active = self._active
        if active and active.handle == handle and self._end(rules.SUCCESSFUL, '', active):
            self._stop()
        return CancelResponse.ACCEPT

    def _end(self, code: int, text: str, which: Active | None = None) -> bool:
        """Ends the active goal, if it is still this one."""
        with self._ending:
            active = self._active
            if active is None or (which is not None and which is not active):
                return False
            self._active = None
        result = FollowJointTrajectory.Result(error_code=code, error_string=text)
        active.handle.execute(partial(_finish, result))
        return True

    def _on_scaling(self, msg: SpeedScalingFactor) -> None:
        if not msg.factor >= 0:
            self._node.get_logger().warning(f'speed scaling of {msg.factor:g} is passed over')
            return
        self._axes.speed_scale = msg.factor


def _finish(result: FollowJointTrajectory.Result, handle: Any) -> FollowJointTrajectory.Result:
    if handle.is_cancel_requested:
        handle.canceled()
    elif result.error_code == rules.SUCCESSFUL:
        handle.succeed()
    else:
        handle.abort()
    return result
