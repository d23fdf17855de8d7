"""The relay: a cell's topics appear on another domain below its name, and nothing goes the other way."""

from __future__ import annotations

import os
import sys
import time
from subprocess import PIPE, Popen

from rclpy.executors import SingleThreadedExecutor

from waam_bringup.node_relay import TOPICS, node_on
from waam_msgs.msg import JobStatus, Telemetry
from waam_node.testing import fresh_domain

CELL, SITE = fresh_domain(), fresh_domain()
CODE = f"""from waam_bringup.node_relay import relay
relay('cell2', {CELL}, {SITE}, 'LOCALHOST', lambda: print('up', flush=True))"""


def spin_until(node, condition, timeout=20.0):
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    end = time.monotonic() + timeout
    while not condition() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    return condition()


def test_a_cell_is_heard_on_the_site_under_its_name_and_not_the_other_way(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    heard: list = []
    back: list = []
    with (
        Popen([sys.executable, '-c', CODE], stdout=PIPE, env=os.environ, text=True) as process,
        node_on(CELL, 'LOCALHOST', 'a_cell') as cell,
        node_on(SITE, 'LOCALHOST', 'a_screen') as screen,
    ):
        try:
            status = cell.create_publisher(JobStatus, 'job_status', TOPICS['job_status'][1])
            status.publish(JobStatus(job_id='said before anybody listened'))
            assert process.stdout.readline() == 'up\n'
            screen.create_subscription(
                JobStatus, '/cell2/job_status', heard.append, TOPICS['job_status'][1]
            )
            assert spin_until(screen, lambda: heard)
            assert heard[0].job_id == 'said before anybody listened'
            names = dict(screen.get_topic_names_and_types())
            assert {f'/cell2/{t.lstrip("/")}' for t in TOPICS} <= set(names)

            cell.create_subscription(Telemetry, 'telemetry', back.append, 10)
            out = screen.create_publisher(Telemetry, '/cell2/telemetry', TOPICS['telemetry'][1])
            out.publish(Telemetry())
            assert not spin_until(cell, lambda: back, timeout=1.0)
            assert screen.count_subscribers('/cell2/telemetry') == 0
            assert not screen.get_service_names_and_types_by_node('relay', '/cell2')
        finally:
            process.terminate()
