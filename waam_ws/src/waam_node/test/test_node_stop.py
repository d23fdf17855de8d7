"""A node that is told to end, at a bad moment."""

from __future__ import annotations

import os
import subprocess
import sys

from waam_node.testing import fresh_domain

STOPPED = """
import signal

import rclpy

from waam_node.node import main
from rclpy.node import Node


def interrupted():
    node = Node('interrupted')
    with rclpy.get_default_context()._lock:  # as in the midst of rclpy.ok()
        signal.raise_signal(signal.SIGTERM)
    return node


main(interrupted)
"""


STOPPED_WHILE_MADE = """
import signal
import time

import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node

from waam_msgs.action import RunJob
from waam_node.node import main


def half_made():
    node = Node('half_made')
    signal.raise_signal(signal.SIGTERM)
    while rclpy.ok():
        time.sleep(0.01)
    ActionServer(node, RunJob, 'run_job', lambda goal: None)
    return node


main(half_made)
"""
STOPPED_IN_A_CALLBACK = """
import os
import signal
import time

from waam_node.node import main
from std_msgs.msg import Empty
from rclpy.node import Node


class Busy(Node):
    def __init__(self):
        super().__init__('busy')
        self.out = self.create_publisher(Empty, 'out', 1)
        self.create_timer(0.01, self.work)

    def work(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
        self.out.publish(Empty())  # raises where the context has gone
        print('done', flush=True)


main(Busy)
"""
BAD_PARAMETER = """
from waam_node.node import main


def refused():
    raise ValueError('rate: -1 is too small')


main(refused)
"""


def ended(program: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, 'ROS_DOMAIN_ID': str(fresh_domain())}
    return subprocess.run(
        [sys.executable, '-c', program], env=env, capture_output=True, text=True, timeout=60.0
    )


def test_a_node_that_is_stopped_while_it_asks_whether_it_may_go_on_ends():
    done = ended(STOPPED)
    assert done.returncode == 0, done.stderr


def test_a_node_that_is_stopped_while_it_is_made_ends_without_an_error():
    done = ended(STOPPED_WHILE_MADE)
    assert done.returncode == 0, done.stderr
    assert 'error' not in done.stderr


def test_a_callback_that_runs_when_the_node_is_stopped_comes_to_its_end():
    done = ended(STOPPED_IN_A_CALLBACK)
    assert (done.returncode, done.stdout) == (0, 'done\n'), done.stderr


def test_a_bad_parameter_is_told_in_one_line():
    done = ended(BAD_PARAMETER)
    assert (done.returncode, done.stderr) == (2, 'error: rate: -1 is too small\n')
