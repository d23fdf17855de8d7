"""The bridge in real time behind a driver in a process of its own, which dies, hangs or lags; the welder stays."""

from __future__ import annotations

import re
import signal
import time

import pytest
from bridge_graph import until
from control_msgs.msg import SpeedScalingFactor
from driver_cell import Cell
from rclpy.qos import DurabilityPolicy, QoSProfile

from waam_msgs.srv import Command

LEASE = 0.5  # s


@pytest.fixture
def cell(tmp_path):
    made = Cell(tmp_path)
    yield made
    made.driver.send_signal(signal.SIGCONT)
    made.close()


@pytest.mark.parametrize('what', ['dies', 'hangs'])
def test_the_arc_goes_out_with_the_driver(cell, what):
    cell.strike()
    cell.driver.send_signal(signal.SIGKILL if what == 'dies' else signal.SIGSTOP)
    began = time.monotonic()
    until(lambda: not cell.welder.arc, 5.0, 'the arc to end')
    assert time.monotonic() - began <= LEASE
    assert cell.welder.heard > began  # it was told so
    until(lambda: 'joint states are' in cell.state.message, what='the reason')
    assert 'the arc is cut' in cell.state.message
    if what == 'hangs':  # nothing begins again by itself
        cell.driver.send_signal(signal.SIGCONT)
        time.sleep(1.0)
        assert not cell.welder.arc and cell.telemetry[-1].state != 1


def test_a_driver_that_lags_is_told_before_the_arc(tmp_path):
    cell = Cell(tmp_path, late=0.35)
    try:
        cell.home()
        until(lambda: 'the last joint states are 0.3' in cell.state.message, what='the reason')
        assert not cell.state.homed and not cell.welder.arc
    finally:
        cell.close()


@pytest.mark.parametrize('delay,offset', [(0.0, 0.05), (0.06, 0.0), (0.06, -0.05), (0.04, 0.05)])
def test_goals_that_come_late_or_by_another_clock_are_taken(tmp_path, delay, offset):
    """A JointTrajectoryController refuses a goal that has ended by its clock, also one that only stands."""
    cell = Cell(tmp_path, delay=delay, offset=offset)
    try:
        cell.strike()
        time.sleep(1.5)
        assert cell.welder.arc, cell.state.message
        assert 'ERROR' not in (tmp_path / 'driver.log').read_text()
    finally:
        cell.close()


@pytest.mark.parametrize(
    'driver,words',
    [
        ({'offset': 0.2}, 'joint states are stamped .* in the future: the clocks'),
        ({'delay': 0.2}, 'goals take .* to the driver, delay is 40 ms: raise delay'),
    ],
)
def test_what_cannot_be_followed_in_time_is_not_armed(tmp_path, driver, words):
    cell = Cell(tmp_path, **driver)
    try:
        answer = cell.arm()
        assert answer.error_code and re.search(words, answer.message), answer.message
    finally:
        cell.close()


def test_a_controller_that_is_slowed_down_gets_no_arc_and_loses_the_one_it_has(cell):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    pendant = cell.node.create_publisher(
        SpeedScalingFactor, 'joint_trajectory_controller/speed_scaling_input', latched
    )
    cell.strike()
    pendant.publish(SpeedScalingFactor(factor=0.5))
    until(lambda: not cell.welder.arc, 5.0, 'the arc to end')
    until(lambda: 'goes at 50% of the speed' in cell.state.message, what='the reason')
    cell.command(Command.Request.STOP)
    until(lambda: cell.telemetry[-1].state == 0, what='the end of the job')
    answer = cell.ask(Command.Request.ARM, text='job', names=['bridge'])
    assert answer.error_code and 'goes at 50% of the speed' in answer.message
