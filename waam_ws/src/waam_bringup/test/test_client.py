"""The command line's client without a graph, and with a server of its action, on domains of their own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from itertools import count
from types import SimpleNamespace

import pytest
from rclpy.action import ActionClient
from rclpy.task import Future

from waam_bringup.client import ASKINGS, SENDINGS, ClientError, GraphClient
from waam_msgs.action import RunJob
from waam_msgs.msg import MachineState
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
LATE = """
import time
time.sleep(4)
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger
from waam_msgs.msg import JobStatus

def resume(request, response):
    response.success = True
    return response

rclpy.init()
node = rclpy.create_node('job_sequencer')
server = node.create_service(Trigger, 'job_sequencer/resume', resume)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
status = node.create_publisher(JobStatus, 'job_status', latched)
status.publish(JobStatus(state=JobStatus.PAUSED))
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

# The controller takes every override; the process control hears only the second one.
DEAF = """
import rclpy
from waam_msgs.msg import Override, ProcessControl, Telemetry
from waam_node.qos import NEWEST, TELEMETRY

rclpy.init()
node = rclpy.create_node('job_sequencer')
orders, operator = [], [1.0]
frames = node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
factors = node.create_publisher(Override, 'process_override', NEWEST)
status = node.create_publisher(ProcessControl, 'process_control', TELEMETRY)

def hear(msg):
    orders.append(msg.wire_factor)
    if len(orders) > 1:
        operator[0] = msg.wire_factor
    print(len(orders), flush=True)

def tell():
    factor = orders[-1] if orders else 1.0
    factors.publish(Override(speed_factor=1.0, wire_factor=1.1))
    status.publish(ProcessControl(speed_factor=1.0, wire_factor=1.1, operator_speed_factor=1.0,
                                  operator_wire_factor=operator[0]))
    frames.publish(Telemetry(speed_override=1.0, wire_override=1.1 * factor))

node.create_subscription(Override, 'override', hear, NEWEST)
node.create_timer(0.02, tell)
rclpy.spin(node)
"""


@contextmanager
def process(code: str):
    env = os.environ | {'ROS_DOMAIN_ID': str(fresh_domain())}
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            [sys.executable, '-c', code], env=env, stdout=subprocess.PIPE, stderr=errors
        )
        try:
            yield child, env
        finally:
            child.kill()
            print(f'the process ended with {child.wait()}')  # shown where the test fails
            errors.seek(0)
            print(errors.read().decode(errors='replace')[-4000:])


@pytest.fixture
def server():
    with process(SERVER) as (child, env):
        assert child.stdout.readline() == b'up\n'
        yield env


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


@pytest.mark.parametrize('asks', ['resume', 'running_job'])
def test_a_sequencer_that_is_found_late_does_not_pass_for_one_without_a_job(asks):
    """`waam job resume` on a busy machine took a paused job for none, and looked for an interrupted one."""
    with process(LATE) as (_, env), GraphClient(int(env['ROS_DOMAIN_ID'])) as client:
        assert getattr(client, asks)()


@pytest.mark.parametrize('lost', [1, 2, 9])
def test_a_goal_that_never_reached_its_server_is_sent_again(server, monkeypatch, lost):
    """A sequencer that has just been restarted can be found before it hears."""
    monkeypatch.setattr('waam_bringup.client.ANSWER_S', 0.5)
    really, sent = ActionClient.send_goal_async, []

    def send(self, goal, **options):
        sent.append(goal)
        return Future() if len(sent) <= lost else really(self, goal, **options)

    monkeypatch.setattr(ActionClient, 'send_goal_async', send)
    with GraphClient(int(server['ROS_DOMAIN_ID'])) as client:
        if lost < SENDINGS:
            assert client.run_job(RunJob.Goal(name='one'), lambda _: None).job_dir == 'one'
        else:
            with pytest.raises(ClientError, match='did not answer the goal'):
                client.run_job(RunJob.Goal(), lambda _: None)
    assert len(sent) == min(lost + 1, SENDINGS)


def test_an_override_that_the_process_control_has_not_heard_is_said_again():
    """It would take the operator's factor for an error, and take it back."""
    with process(DEAF) as (child, env), GraphClient(int(env['ROS_DOMAIN_ID'])) as client:
        speed, wire = client.override(1.0, 0.9, 'test')
        assert (speed, wire) == pytest.approx((1.0, 0.99))
        child.kill()
        assert child.stdout.read().split()[:2] == [b'1', b'2']


class Handle:
    """Of a goal whose result comes with the `answer`th request for it; 0 = never."""

    def __init__(self, answer: int) -> None:
        self.answer, self.asked = answer, 0

    def get_result_async(self) -> Future:
        self.asked += 1
        future = Future()
        if self.asked == self.answer:
            future.set_result('done')
        return future


@pytest.fixture
def deaf(monkeypatch) -> GraphClient:
    """A client that hears nothing, in a hurry."""
    for name, seconds in (('ANSWER_S', 0.02), ('ALIVE_S', 0.005)):
        monkeypatch.setattr(f'waam_bringup.client.{name}', seconds)
    client = GraphClient.__new__(GraphClient)
    client.executor = SimpleNamespace(spin_once=lambda timeout_sec: time.sleep(0.001))
    return client


def test_the_result_of_a_goal_that_was_not_answered_is_requested_again(deaf):
    """Goal and first request may both have gone to a server that had just died."""
    handle = Handle(answer=3)
    assert deaf._result(handle, False, lambda: '') == 'done'
    assert handle.asked == 3


@pytest.mark.parametrize('answered,asked', [(True, 1), (False, ASKINGS)])
def test_the_result_is_requested_a_bounded_number_of_times(deaf, answered, asked):
    handle, looks = Handle(answer=0), count()
    with pytest.raises(ClientError, match='gone'):
        deaf._result(handle, answered, lambda: 'gone' if next(looks) > 100 else '')
    assert handle.asked == asked


def test_a_graph_that_does_not_get_ready_tells_what_the_bridge_says():
    """The nodes behind it wait for its ticks: a list of them would hide the reason."""
    why = "robot: joint_states has no 'foo', it has joint_1"
    with GraphClient(fresh_domain()) as client:
        client.machine = MachineState(connected=False, message=why)
        with pytest.raises(ClientError, match=f'not ready after 0 s: {why}$'):
            client.wait_ready({'bridge', 'cell'}, 0.2, dict, patience=60.0)
        client.machine = None
        with pytest.raises(ClientError, match='not ready after 0 s: bridge, cell does not answer'):
            client.wait_ready({'bridge', 'cell'}, 0.2, dict, patience=60.0)
