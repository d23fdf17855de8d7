"""A robot's driver as a process of its own, in real time, for test_robot_driver.py: follows goals exactly.

python plain_driver.py [--late S]      S: how old its joint states are, and how late it follows
"""

from __future__ import annotations

import argparse
import time
from collections import deque

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer
from sensor_msgs.msg import JointState

from waam_robot.station import Station
from waam_robot_bridge.params import NAMES

PARK = np.array([[0.010, 0.010, 0.190]])  # m
ACTION = 'joint_trajectory_controller/follow_joint_trajectory'
PERIOD = 0.01  # s


class PlainDriver:
    """Joints as the newest goal has them."""

    def __init__(self, late: float) -> None:
        self.node = rclpy.create_node('driver')
        self._late = late
        self._joints = Station().joints(PARK)[0]
        self._goals: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=100)
        self._out = self.node.create_publisher(JointState, 'joint_states', 10)
        self._server = ActionServer(
            self.node, FollowJointTrajectory, ACTION, self._take, result_timeout=1
        )
        self.node.create_timer(PERIOD, self._tell)

    def _take(self, handle) -> FollowJointTrajectory.Result:
        t = handle.request.trajectory
        times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in t.points]
        begin = t.header.stamp.sec + 1e-9 * t.header.stamp.nanosec
        order = [t.joint_names.index(name) for name in NAMES]
        joints = np.array([p.positions for p in t.points])[:, order]
        self._goals.append((begin, np.array(times), joints))
        handle.succeed()
        return FollowJointTrajectory.Result()

    def _tell(self) -> None:
        now = time.time() - self._late
        begun = [g for g in self._goals if g[0] <= now]
        if begun:
            begin, times, joints = begun[-1]
            self._joints = np.array([np.interp(now - begin, times, j) for j in joints.T])
        msg = JointState(name=list(NAMES), position=self._joints.tolist())
        msg.header.stamp = Time(sec=int(now), nanosec=int(now % 1 * 1e9))
        self._out.publish(msg)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument('--late', type=float, default=0.0)
    rclpy.init()
    rclpy.spin(PlainDriver(parser.parse_args().late).node)


if __name__ == '__main__':
    main()
