"""The robot of the simulated cell over ROS: trajectory controller, joint states, and the welding device."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue
from rclpy.action import ActionServer, GoalResponse
from rclpy.node import Node
from sensor_msgs.msg import JointState

from waam_node import qos

from .plant import INPUT_GAS_OK, OUTPUT_ARC, OUTPUT_GAS, Reading

NAMES = ('joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6', 'tilt', 'turn')
ACTION = 'joint_trajectory_controller/follow_joint_trajectory'
WELDING = 'welding'
# s that the end of a goal can be asked for, as with controllers in C++: with every goal the states of all that are kept
# go out, and rclpy's own 15 minutes of them cost the bridge most of its time.
RESULT_KEPT_S = 10
WATCHDOG_US = 100_000  # without outputs for so long the device drops the arc
Follow = Callable[[int, np.ndarray, np.ndarray, np.ndarray], None]


def _stamp(us: int) -> Time:
    return Time(sec=us // 1_000_000, nanosec=us % 1_000_000 * 1000)


def goal_from_msg(
    msg: FollowJointTrajectory.Goal, names: Sequence[str] = NAMES
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """Start (us), time (N,) s, joints and rates (N, n) in the order of `names`. ValueError says what is wrong."""
    t = msg.trajectory
    if sorted(t.joint_names) != sorted(names):
        wrong = sorted(set(t.joint_names) ^ set(names))
        raise ValueError(f'the joints differ from those of the robot: {", ".join(wrong)}')
    if len(t.points) < 2:
        raise ValueError(f'{len(t.points)} points, at least 2 are wanted')
    if any(len(p.positions) != len(names) or len(p.velocities) != len(names) for p in t.points):
        raise ValueError('a point has not one position and one velocity for every joint')
    order = [list(t.joint_names).index(name) for name in names]
    time = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in t.points])
    joints = np.array([p.positions for p in t.points])[:, order]
    rates = np.array([p.velocities for p in t.points])[:, order]
    if not (np.isfinite(joints).all() and np.isfinite(rates).all()) or (np.diff(time) <= 0).any():
        raise ValueError('values have to be finite and times have to rise')
    start = t.header.stamp
    return start.sec * 1_000_000 + start.nanosec // 1000, time, joints, rates


class TrajectoryController:
    """Action server: hands good goals to `follow` (called under `lock`), refuses others and says why in the log.

    A goal is taken before it is accepted, so that time can wait for it (`waam_robot_bridge.node_transport`). It has its
    result at once, not when it ends: one that replaces another ends that one. names: of the
    joints; beyond: which of joints (N, n) is beyond its limit, '' = none; now_us: time of the cell. As ros2_control's
    controller it refuses a goal that has ended already, or has a speed at its end.
    """

    def __init__(
        self,
        node: Node,
        lock: threading.Lock,
        follow: Follow,
        names: Sequence[str] = NAMES,
        beyond: Callable[[np.ndarray], str] = lambda joints: '',
        now_us: Callable[[], int] = lambda: 0,
    ) -> None:
        self._node, self._lock, self._follow = node, lock, follow
        self._names, self._beyond, self._now_us = names, beyond, now_us
        self._states = node.create_publisher(JointState, 'joint_states', qos.BEAT)
        self._server = ActionServer(
            node,
            FollowJointTrajectory,
            ACTION,
            execute_callback=self._execute,
            goal_callback=self._judge,
            result_timeout=RESULT_KEPT_S,
        )

    def tell(self, time_us: int, joints: np.ndarray, rates: np.ndarray) -> None:
        """Publishes the joint states."""
        msg = JointState(name=list(self._names), position=joints.tolist(), velocity=rates.tolist())
        msg.header.stamp = _stamp(time_us)
        self._states.publish(msg)

    def _judge(self, goal: FollowJointTrajectory.Goal) -> GoalResponse:
        try:
            taken = goal_from_msg(goal, self._names)
            said = self._broken(*taken) or self._beyond(taken[2])
        except ValueError as e:
            said = str(e)
        if said:
            self._node.get_logger().error(f'goal refused: {said}')
            return GoalResponse.REJECT
        with self._lock:
            self._follow(*taken)
        return GoalResponse.ACCEPT

    def _broken(self, start_us: int, time: np.ndarray, _: np.ndarray, rates: np.ndarray) -> str:
        late = (self._now_us() - start_us) * 1e-6 - float(time[-1])
        if start_us and late > 0:
            return f'it has ended {late:.3f} s ago'
        return 'a joint still moves at its end' if np.abs(rates[-1]).max() > 1e-9 else ''

    def _execute(self, handle: Any) -> FollowJointTrajectory.Result:
        handle.succeed()
        return FollowJointTrajectory.Result()


class Welder:
    """The welding device: outputs from weld_command as long as they come, what it measures on weld_state."""

    def __init__(self, node: Node, now_us: Callable[[], int]) -> None:
        self._node, self._now_us = node, now_us
        self._outputs, self._heard_us = (0, 0.0, 0.0), -WATCHDOG_US
        self._told_us = 0  # time of the newest command, 0 = nobody tells any
        self.news = threading.Event()  # a command has come
        self._out = node.create_publisher(DynamicInterfaceGroupValues, 'weld_state', qos.BEAT)
        node.create_subscription(
            DynamicInterfaceGroupValues, 'weld_command', self._on_command, qos.BEAT
        )

    def behind_us(self) -> int:
        """How far the newest command is behind the cell; 0 where there is none."""
        return self._now_us() - self._told_us if self._told_us else 0

    @property
    def alone(self) -> bool:
        """Nobody tells any commands."""
        return not self._told_us

    def give_up(self) -> None:
        """Nobody waits for commands until the next one comes."""
        self._told_us = 0

    def outputs(self) -> tuple[int, float, float]:
        """Bits, wire (m/s) and voltage (V) that act now."""
        if self._now_us() - self._heard_us > WATCHDOG_US:
            return 0, 0.0, 0.0
        return self._outputs

    def tell(self, reading: Reading, time_us: int) -> None:
        """Publishes what it measures."""
        gas = float(reading.inputs & INPUT_GAS_OK != 0)
        one = InterfaceValue(interface_names=['gas_ok', 'current', 'voltage', 'wire_speed'])
        one.values = [gas, reading.current, reading.voltage, reading.wire_speed]
        msg = DynamicInterfaceGroupValues(interface_groups=[WELDING], interface_values=[one])
        msg.header.stamp = _stamp(time_us)
        self._out.publish(msg)

    def _on_command(self, msg: DynamicInterfaceGroupValues) -> None:
        groups = dict(zip(msg.interface_groups, msg.interface_values, strict=False))
        group = groups.get(WELDING, InterfaceValue())
        found = dict(zip(group.interface_names, group.values, strict=False))
        try:
            bits = OUTPUT_ARC * (found['arc'] > 0.5) | OUTPUT_GAS * (found['gas'] > 0.5)
            self._outputs = (int(bits), found['wire_feed_speed'], found['voltage'])
        except KeyError as e:
            text = f'weld_command: no {e} in the group {WELDING}'
            self._node.get_logger().error(text, throttle_duration_sec=5.0)
            return
        self._heard_us = self._now_us()
        self._told_us = msg.header.stamp.sec * 1_000_000 + msg.header.stamp.nanosec // 1000
        self.news.set()
