"""The bridge in real time behind a driver in a process of its own, which dies, hangs or lags; the welder stays."""

from __future__ import annotations

import re
import signal
import sys
import time
from pathlib import Path

import pytest
from bridge_graph import Graph, until
from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue

from waam_msgs.srv import Command
from waam_node import qos
from waam_process.segment import Kind, Segment

DRIVER = Path(__file__).parent / 'plain_driver.py'
LEASE = 0.5  # s
START, END = (0.02, 0.02, 0.17), (0.22, 0.02, 0.17)  # m, machine coordinates


class Welder:
    """Tells what it is told: 150 A while there is an arc."""

    def __init__(self, graph: Graph) -> None:
        self.arc, self.heard = False, 0.0  # s, steady clock: when it was told last
        self._told = 0
        self._out = graph.node.create_publisher(DynamicInterfaceGroupValues, 'weld_state', qos.BEAT)
        graph.node.create_subscription(
            DynamicInterfaceGroupValues, 'weld_command', self._on_command, qos.BEAT
        )
        graph.node.create_timer(0.02, self._tell)

    def _on_command(self, msg: DynamicInterfaceGroupValues) -> None:
        group = msg.interface_values[0]
        self.arc = dict(zip(group.interface_names, group.values, strict=True))['arc'] > 0.5
        self.heard = time.monotonic()

    def _tell(self) -> None:
        one = InterfaceValue(interface_names=['gas_ok', 'current', 'voltage', 'wire_speed'])
        self._told += 1  # a reading that never changes is an alarm
        ripple = 0.3 * (self._told % 7)
        one.values = [1.0, *((150.0 + ripple, 22.0 + ripple, 0.1) if self.arc else (0.0, 0.0, 0.0))]
        msg = DynamicInterfaceGroupValues(interface_groups=['welding'], interface_values=[one])
        self._out.publish(msg)


class Cell(Graph):
    """Bridge, driver and welding device."""

    def __init__(self, logs: Path, **driver: float) -> None:
        super().__init__(logs, cell=False, state_timeout='0.3')
        self.welder = Welder(self)
        options = [a for key, value in driver.items() for a in (f'--{key}', str(value))]
        self.driver = self.start('driver', [sys.executable, str(DRIVER), *options])
        self.processes.append(self.driver)

    def home(self) -> None:
        until(lambda: self.state.connected, what='connection')
        self.command(Command.Request.RESET)
        self.command(Command.Request.HOME)

    def strike(self) -> None:
        """Homed, armed, and 20 s of a bead before it."""
        self.home()
        until(lambda: self.state.homed and self.telemetry[-1].state == 0, what='homing')
        self.command(Command.Request.SET_ZERO, vector=(0.0, 0.0, 0.0))
        self.command(Command.Request.ARM, text='job', names=['bridge'])
        time.sleep(0.3)
        here = self.telemetry[-1].position
        source = {'arc': True, 'wire_feed_speed': 0.1, 'voltage': 22.0}
        answer = self.enqueue(
            [
                Segment(0, Kind.IDLE, (here.x, here.y, here.z), START, 0.1),
                Segment(1, Kind.DEPOSIT, START, END, 0.01, **source),
            ]
        )
        assert (answer.error_code, answer.accepted) == (0, 2), answer.message
        until(lambda: self.welder.arc, what='the arc')
        time.sleep(0.5)
        assert self.welder.arc


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
        cell.home()
        until(lambda: cell.state.homed and cell.telemetry[-1].state == 0, what='homing')
        cell.command(Command.Request.SET_ZERO, vector=(0.0, 0.0, 0.0))
        answer = cell.ask(Command.Request.ARM, text='job', names=['bridge'])
        assert answer.error_code and re.search(words, answer.message), answer.message
    finally:
        cell.close()
