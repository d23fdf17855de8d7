"""A robot's driver as a process of its own, in real time: the trajectory controller of the simulated cell, which takes
and ends goals by the rules of a stock one, before axes that follow exactly. For test_robot_driver.py and bench_ros.py.

python plain_driver.py [--late S] [--delay S] [--offset S]
--late: how old its joint states are, and how late it follows; --delay: until a goal reaches it; --offset: of its clock
"""

from __future__ import annotations

import argparse
import threading
import time

import numpy as np
import rclpy
from control_msgs.action import FollowJointTrajectory
from rclpy.action import GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor

from waam_robot.station import Station
from waam_sim.node_trajectory import TrajectoryController
from waam_sim.robot import Trajectory

PARK = np.array([[0.010, 0.010, 0.190]])  # m
PERIOD = 0.01  # s
SPAN_US = 1000  # in which the speed is measured


class ExactAxes:
    """They are where the newest goal has them, `late` s ago by a clock that is `offset` s ahead."""

    def __init__(self, late: float, offset: float) -> None:
        self.speed_scale, self.behind_us = 1.0, 0
        self._late, self._offset = late, offset
        self._goal: Trajectory | None = None
        self._told = self.now_us(), Station().joints(PARK)[0], np.zeros(8)

    def now_us(self) -> int:
        return int((time.time() + self._offset) * 1e6)

    def follow(self, *goal) -> None:
        self._goal, self.behind_us = Trajectory(*goal), 0

    def state(self) -> tuple[int, np.ndarray, np.ndarray]:
        return self._told

    def beyond(self, joints: np.ndarray) -> str:
        return ''

    def move(self) -> None:
        now = self.now_us() - int(self._late * 1e6)
        before, joints, rates = self._told
        if self._goal:
            self.behind_us += round((1 - self.speed_scale) * (now - before))
            at = now - self.behind_us
            earlier, joints = self._goal.at(np.array([at - SPAN_US, at]))
            rates = self.speed_scale * (joints - earlier) / (SPAN_US * 1e-6)
        self._told = now, joints, rates


class LateController(TrajectoryController):
    """Goals reach it `delay` s late."""

    delay = 0.0  # s

    def _judge(self, goal: FollowJointTrajectory.Goal) -> GoalResponse:
        time.sleep(self.delay)
        return super()._judge(goal)


def main() -> None:
    parser = argparse.ArgumentParser()
    for name in ('late', 'delay', 'offset'):
        parser.add_argument(f'--{name}', type=float, default=0.0)
    asked = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node('driver')
    lock = threading.Lock()
    axes = ExactAxes(asked.late, asked.offset)
    group = ReentrantCallbackGroup()
    controller = LateController(node, lock, axes, now_us=axes.now_us, callback_group=group)
    controller.delay = asked.delay

    def tick() -> None:
        with lock:
            axes.move()
        controller.tell(*axes.state())

    node.create_timer(PERIOD, tick)
    executor = MultiThreadedExecutor(8)
    executor.add_node(node)
    executor.spin()


if __name__ == '__main__':
    main()
