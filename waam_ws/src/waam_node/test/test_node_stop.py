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


def test_a_node_that_is_stopped_while_it_asks_whether_it_may_go_on_ends():
    env = {**os.environ, 'ROS_DOMAIN_ID': str(fresh_domain())}
    done = subprocess.run(
        [sys.executable, '-c', STOPPED], env=env, capture_output=True, text=True, timeout=60.0
    )
    assert done.returncode == 0, done.stderr
