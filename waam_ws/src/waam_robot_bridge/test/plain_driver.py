"""A robot's driver as a process of its own, in real time, for test_robot_driver.py. It follows goals exactly, and takes
and refuses them by the documented rules of ros2_control's JointTrajectoryController: no goal without points, with other
joints, with times that do not rise, with a speed at its end, or that has ended already by its own clock; a new goal
cancels the one before; a goal has its result when it ends.

python plain_driver.py [--late S] [--delay S] [--offset S]
--late: how old its joint states are, and how late it follows; --delay: until a goal reaches it; --offset: of its clock
"""

from __future__ import annotations

import argparse
import threading
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from sensor_msgs.msg import JointState

from waam_robot.station import Station
from waam_robot_bridge.params import NAMES

PARK = np.array([[0.010, 0.010, 0.190]])  # m
ACTION = 'joint_trajectory_controller/follow_joint_trajectory'
PERIOD = 0.01  # s
Result = FollowJointTrajectory.Result


def times_of(t) -> tuple[float, np.ndarray]:
    """Start and times of the points, s."""
    begin = t.header.stamp.sec + 1e-9 * t.header.stamp.nanosec
    return begin, np.array(
        [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in t.points]
    )


def wrong(t, now: float) -> str:
    """Which rule of `validate_trajectory_msg` a trajectory breaks, '' = none."""
    if not t.points:
        return 'Empty trajectory received.'
    if sorted(t.joint_names) != sorted(NAMES):
        return f'Incoming joints {t.joint_names} do not match the controller'
    begin, times = times_of(t)
    if begin and begin + times[-1] < now:
        return 'Received trajectory with non-zero start time whose end is in the past'
    if any(abs(v) > 1e-9 for v in t.points[-1].velocities):
        return 'Velocity of last trajectory point is not zero'
    if (np.diff(times) <= 0).any():
        return 'Time between points is not strictly increasing'
    if any(len(p.positions) != len(NAMES) or p.effort for p in t.points):
        return 'Mismatch between joint_names and positions'
    return ''


class PlainDriver:
    """Joints as the newest goal has them."""

    def __init__(self, late: float, delay: float, offset: float) -> None:
        self.node = rclpy.create_node('driver')
        self._late, self._delay, self._offset = late, delay, offset
        self._joints = Station().joints(PARK)[0]
        self._lock = threading.Lock()
        self._goals: list[tuple[float, np.ndarray, np.ndarray]] = []
        self._active = None
        self._out = self.node.create_publisher(JointState, 'joint_states', 10)
        self._server = ActionServer(
            self.node, FollowJointTrajectory, ACTION, self._take, goal_callback=self._judge, result_timeout=1,
            callback_group=ReentrantCallbackGroup(),
        )  # fmt: skip
        self.node.create_timer(PERIOD, self._tell)

    def _now(self) -> float:
        return time.time() + self._offset

    def _judge(self, goal) -> GoalResponse:
        time.sleep(self._delay)
        said = wrong(goal.trajectory, self._now())
        if said:
            self.node.get_logger().error(said)
        return GoalResponse.REJECT if said else GoalResponse.ACCEPT

    def _take(self, handle) -> Result:
        t = handle.request.trajectory
        begin, times = times_of(t)
        order = [t.joint_names.index(name) for name in NAMES]
        joints = np.array([p.positions for p in t.points])[:, order]
        with self._lock:
            self._active = handle.goal_id
            self._goals = [*self._goals[-9:], (begin, times, joints)]
        while self._active == handle.goal_id and self._now() - self._late < begin + times[-1]:
            time.sleep(PERIOD)
        if self._active != handle.goal_id:
            handle.abort()
            text = 'Current goal cancelled due to new incoming action.'
            return Result(error_code=Result.INVALID_GOAL, error_string=text)
        handle.succeed()
        return Result()

    def _tell(self) -> None:
        now = self._now() - self._late
        with self._lock:
            begun = [g for g in self._goals if g[0] <= now]
        if begun:
            begin, times, joints = begun[-1]
            self._joints = np.array([np.interp(now - begin, times, j) for j in joints.T])
        msg = JointState(name=list(NAMES), position=self._joints.tolist())
        msg.header.stamp = Time(sec=int(now), nanosec=int(now % 1 * 1e9))
        self._out.publish(msg)


def main() -> None:
    parser = argparse.ArgumentParser()
    for name in ('late', 'delay', 'offset'):
        parser.add_argument(f'--{name}', type=float, default=0.0)
    asked = parser.parse_args()
    rclpy.init()
    executor = MultiThreadedExecutor(8)
    executor.add_node(PlainDriver(asked.late, asked.delay, asked.offset).node)
    executor.spin()


if __name__ == '__main__':
    main()
