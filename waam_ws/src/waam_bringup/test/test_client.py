"""The command line's client without a graph, and with a server of its action, on domains of their own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from waam_bringup.client import ClientError, GraphClient
from waam_msgs.action import RunJob
from waam_node.testing import fresh_domain

SERVER = """
import rclpy
from rclpy.action import ActionServer
from waam_msgs.action import RunJob

def execute(goal):
    goal.publish_feedback(RunJob.Feedback())
    goal.succeed()
    return RunJob.Result(job_dir=goal.request.name)

rclpy.init()
node = rclpy.create_node('job_sequencer')
server = ActionServer(node, RunJob, 'job_sequencer/run_job', execute)
print('up', flush=True)
rclpy.spin(node)
"""
CLIENTS = """
import os
from waam_bringup.client import GraphClient
from waam_msgs.action import RunJob

for name in ('one', 'two', 'three'):
    with GraphClient(int(os.environ['ROS_DOMAIN_ID'])) as client:
        for _ in range(2):
            assert client.run_job(RunJob.Goal(name=name), lambda _: None).job_dir == name
    print(len(os.listdir('/proc/self/task')))
"""


@pytest.fixture
def server():
    env = os.environ | {'ROS_DOMAIN_ID': str(fresh_domain())}
    process = subprocess.Popen(
        [sys.executable, '-c', SERVER], env=env, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        assert process.stdout.readline() == b'up\n'
        yield env
    finally:
        process.kill()
        process.wait()


def test_a_closed_client_leaves_no_thread_of_its_participant_behind(server):
    """A process that runs job after job, as campaigns do, would lose the graph after some forty."""
    done = subprocess.run(
        [sys.executable, '-c', CLIENTS], env=server, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    threads = [int(line) for line in done.stdout.split()]
    assert len(threads) == 3
    assert threads[0] == threads[1] == threads[2]


def test_a_client_that_asked_for_a_job_leaves_the_domain_when_it_is_closed(monkeypatch):
    """Participants are numbered; in a process that runs many jobs they would soon pass what discovery looks for."""
    monkeypatch.setattr('waam_bringup.client.SERVER_S', 5.0)  # there is none to wait for
    domain, name = fresh_domain(), f'waam_cli_{os.getpid()}'
    with GraphClient(domain) as watcher:

        def here() -> int:
            return watcher.node.get_node_names().count(name)

        with GraphClient(domain) as client:
            assert watcher.until(lambda: here() == 2, 10.0)
            with pytest.raises(ClientError, match='job_sequencer is not there'):
                client.run_job(RunJob.Goal(), lambda status: None)
        assert watcher.until(lambda: here() == 1, 10.0)
