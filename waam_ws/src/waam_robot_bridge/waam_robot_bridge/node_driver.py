"""The robot's driver over ROS: action FollowJointTrajectory and topic joint_states; and the welding device."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import DynamicInterfaceGroupValues, JointTrajectoryControllerState
from rclpy._rclpy_pybind11 import RCLError
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState as JointStateMsg

from waam_node import qos

from . import conversions as convert
from .controller import JointState
from .goals import Goal
from .params import RobotParams
from .timing import Timing

GOOD = (FollowJointTrajectory.Result.SUCCESSFUL,)
KEPT = 200  # joint states
# us without a joint state while later ones are there: some were lost on a busy computer
HOLE_US = 30_000
HELD = 1.0  # s after a refused goal until the machine may be resumed
TAKEN_US = 10_000  # us of controller time by which a simulated cell may be ahead of a goal on its way to it
PATIENCE = 1.0  # s of the steady clock that it waits for such a goal
SILENT = 0.3  # s of the steady clock and of ROS time, for a simulated cell may stand still
LOST = 2.0  # s of the steady clock
SCALING_S = 0.05  # s between looks at the controller's state, which comes as often as it computes
FULL = 0.01  # share by which the speed may be off


class RosDriver:
    """`waam_robot_bridge.controller.Driver`. on_state is called with every complete joint state."""

    def __init__(self, node: Node, params: RobotParams, on_state: Callable[[], None]) -> None:
        self._names, self._on_news = params.joint_names, on_state
        self._node, self._action = node, params.trajectory_action
        self._client = ActionClient(node, FollowJointTrajectory, params.trajectory_action)
        self.timing = Timing(params.delay)
        self._known: dict[str, tuple[int, float, float]] = {}
        self._states: deque[JointState] = deque(maxlen=KEPT)
        self._next: Goal | None = None
        self._number = 0  # of the newest goal
        # us, s of the steady clock: the newest goal that is not answered; 0 = all are
        self._asked = (0, 0.0)
        self._refused, self._when = '', 0.0  # why the newest goal is not followed; s, steady clock
        self._odd = ''  # why the joint states cannot be used
        self._scale, self._scaled = 1.0, 0.0  # speed scaling of the controller; s, steady clock
        self.heard = 0.0  # s, steady clock: when the newest complete joint state came
        self.device = ''  # what is wrong with the welding device
        deep = QoSProfile(depth=KEPT, reliability=qos.SENSOR.reliability)
        node.create_subscription(JointStateMsg, 'joint_states', self._on_state, deep)
        self._told_by = params.trajectory_action.rpartition('/')[0] + '/controller_state'
        node.create_subscription(
            JointTrajectoryControllerState, self._told_by, self._on_controller, qos.SENSOR, raw=True
        )

    def follow(self, goal: Goal) -> None:
        """Sends a goal, which replaces the one before: in the executor, for an answer that came to it before this
        thread waits for one would be lost."""
        self._asked = (goal.start_us, time.monotonic())
        self._next = goal
        if self._node.executor is not None:
            self._node.executor.create_task(self._send)

    def waits(self, now_us: int) -> bool:
        """Whether the newest goal is still on its way at controller time now_us, so that simulated time should wait."""
        asked_us, when = self._asked
        return bool(asked_us) and (
            now_us - asked_us >= TAKEN_US and time.monotonic() - when < PATIENCE
        )

    def _send(self) -> None:
        goal, self._next = self._next, None
        if goal is None:
            return
        self._number += 1
        number = self._number
        self._refused = ''
        future = self._client.send_goal_async(convert.goal_to_msg(goal, self._names))
        sent = time.monotonic()
        future.add_done_callback(lambda f: self._on_answer(number, f, goal, sent))

    def state(self, now_us: int) -> JointState | None:
        """The newest complete one that is not later than now_us, else the oldest that is known; where states between
        were lost, what lies between those around now_us."""
        known = list(self._states)
        n = bisect_right(known, now_us, key=lambda s: s.time_us)
        if 0 < n < len(known) and now_us - known[n - 1].time_us > HOLE_US:
            return _between(known[n - 1], known[n], now_us)
        return known[max(n - 1, 0)] if known else None

    @property
    def newest_us(self) -> int:
        """Time of the newest complete joint state, 0 = none."""
        return self._states[-1].time_us if self._states else 0

    @property
    def problem(self) -> str:
        """Why it follows no goal."""
        refused = self._refused if time.monotonic() - self._when < HELD else ''
        return refused or self._odd or self.device or self.scaled

    @property
    def scaled(self) -> str:
        """What the controller tells of its speed where that is not the whole one, '' = nothing."""
        if abs(self._scale - 1.0) <= FULL or time.monotonic() - self._scaled > LOST:
            return ''
        return (
            f"the robot's controller goes at {self._scale:.0%} of the speed ('{self._told_by}', speed_scaling_factor): "
            'set it to 100 %'
        )

    def absent(self) -> str:
        """Why the robot cannot be used at all, '' = it can."""
        if self._odd:
            return self._odd
        if not self._states:
            return "no joint states on topic 'joint_states': is the robot's driver running?"
        if not self._client.server_is_ready():
            return f"no action server '{self._action}': is the trajectory controller running?"
        return ''

    def _on_answer(self, number: int, future: Any, goal: Goal, sent: float) -> None:
        handle = future.result()
        self.timing.answered(time.monotonic() - sent)
        if number == self._number and self._next is None:
            self._asked = (0, 0.0)
            self._on_news()
        if not handle.accepted:
            if number == self._number:
                self._refuse(f"the driver refused a goal of '{self._action}': {self._why(goal)}")
            return
        handle.get_result_async().add_done_callback(lambda f: self._on_result(number, f))

    def _why(self, goal: Goal) -> str:
        """What is known of a refused goal, whose answer gives no reason."""
        begun = self._now_us() - goal.start_us
        ends = goal.time[-1] * 1e3 - begun * 1e-3
        return (
            f'its log says why. Here the goal ends in {ends:.0f} ms; {self.timing.summary()}; its joints must be '
            f'exactly {", ".join(self._names)}'
        )

    def _now_us(self) -> int:
        return self._node.get_clock().now().nanoseconds // 1000

    def _on_result(self, number: int, future: Any) -> None:
        result = future.result().result
        if number == self._number and result.error_code not in GOOD:
            text = result.error_string or f'code {result.error_code}'
            self._refuse(f'the driver gave the goal up: {text}')

    def _on_controller(self, data: bytes) -> None:
        now = time.monotonic()
        if now - self._scaled < SCALING_S:
            return
        try:
            told = deserialize_message(data, JointTrajectoryControllerState)
        except RCLError:  # of a control_msgs before 5.3.0: it has no scaling
            return
        self._scale, self._scaled = told.speed_scaling_factor, now

    def _refuse(self, text: str) -> None:
        self._refused, self._when = text, time.monotonic()

    def _on_state(self, msg: JointStateMsg) -> None:
        """Joints may come in several messages, as arm and positioner have drivers of their own."""
        self._send()
        now = self._now_us()
        stamp = convert.us_from_time(msg.header.stamp) or now
        self.timing.stamped((now - stamp) * 1e-6)
        rates = msg.velocity if len(msg.velocity) == len(msg.name) else [0.0] * len(msg.name)
        for name, at, rate in zip(msg.name, msg.position, rates, strict=False):
            self._known[name] = (stamp, at, rate if np.isfinite(rate) else 0.0)
        missing = [n for n in self._names if n not in self._known]
        if missing:
            self._odd = (
                f"joint_states has no '{missing[0]}', it has {', '.join(sorted(self._known))}"
            )
            return
        values = np.array([self._known[n][1:] for n in self._names])
        if not np.isfinite(values).all():
            self._odd = 'joint_states holds a value that is not finite'
            return
        self._odd = ''
        oldest = min(self._known[n][0] for n in self._names)
        self._states.append(JointState(oldest, values[:, 0], values[:, 1]))
        self.heard = time.monotonic()
        self._on_news()


def _between(a: JointState, b: JointState, at_us: int) -> JointState:
    share = (at_us - a.time_us) / (b.time_us - a.time_us)
    joints = a.joints + share * (b.joints - a.joints)
    return JointState(at_us, joints, a.rates + share * (b.rates - a.rates))


class RosWelder:
    """The welding device: outputs go out on weld_command, what it measures comes in on weld_state."""

    def __init__(self, node: Node) -> None:
        self.reading = convert.WeldReading()
        self._heard, self._heard_ros = 0.0, 0.0  # s, steady clock and ROS time
        self._node = node
        self._out = node.create_publisher(DynamicInterfaceGroupValues, 'weld_command', qos.BEAT)
        node.create_subscription(
            DynamicInterfaceGroupValues, 'weld_state', self._on_state, qos.SENSOR
        )

    def command(self, sample: np.void, time_us: int) -> None:
        """Publishes the outputs; the device needs them again and again."""
        self._out.publish(convert.outputs_to_msg(sample, time_us))

    def problem(self) -> str:
        """Why there must be no arc, '' = nothing."""
        if not self._heard:
            return "nothing on topic 'weld_state': is the welding device running?"
        age = time.monotonic() - self._heard
        silent = age > LOST or min(age, self._now() - self._heard_ros) > SILENT
        return f'the welding device is silent for {age:.2f} s' if silent else ''

    def _now(self) -> float:
        return self._node.get_clock().now().nanoseconds * 1e-9

    def _on_state(self, msg: DynamicInterfaceGroupValues) -> None:
        try:
            self.reading = convert.inputs_from_msg(msg)
        except ValueError as e:
            self._node.get_logger().error(f'weld_state: {e}', throttle_duration_sec=5.0)
            return
        self._heard, self._heard_ros = time.monotonic(), self._now()
