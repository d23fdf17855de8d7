"""The bridge in real time behind a driver in a process of its own and a welding device, for test_robot_driver.py and
bench_ros.py."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from bridge_graph import Graph, until
from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue

from waam_msgs.srv import Command
from waam_node import qos
from waam_process.segment import Kind, Segment

DRIVER = Path(__file__).parent / 'plain_driver.py'
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

    def arm(self) -> Command.Response:
        """Homed, and what the bridge says to a job."""
        self.home()
        until(lambda: self.state.homed and self.telemetry[-1].state == 0, what='homing')
        self.command(Command.Request.SET_ZERO, vector=(0.0, 0.0, 0.0))
        return self.ask(Command.Request.ARM, text='job', names=['bridge'])

    def strike(self, end: tuple[float, float, float] = END) -> None:
        """Homed, armed, and the arc burns on the way to `end` (m), at 10 mm/s."""
        answer = self.arm()
        assert answer.error_code == 0, answer.message
        self.lay(end)
        until(lambda: self.welder.arc, what='the arc')
        time.sleep(0.5)
        assert self.welder.arc

    def lay(self, end: tuple[float, float, float]) -> None:
        """The bead of a cell that is armed."""
        time.sleep(0.3)
        here = self.telemetry[-1].position
        source = {'arc': True, 'wire_feed_speed': 0.1, 'voltage': 22.0}
        answer = self.enqueue(
            [
                Segment(0, Kind.IDLE, (here.x, here.y, here.z), START, 0.1),
                Segment(1, Kind.DEPOSIT, START, end, 0.01, **source),
            ]
        )
        assert (answer.error_code, answer.accepted) == (0, 2), answer.message
