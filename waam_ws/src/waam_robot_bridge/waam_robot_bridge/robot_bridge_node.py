"""The executable `robot_bridge`: the node `bridge` with a robot behind it. Topics, services and lease are the same."""

from __future__ import annotations

from waam_bridge import faults
from waam_bridge.bridge_node import BridgeNode
from waam_bridge.outbox import INFO, WARNING
from waam_node.node import main as node_main

from .node_transport import RobotTransport
from .pace import Pacer, Slowed
from .params import RobotParams
from .timing import Timing


class RobotBridgeNode(BridgeNode):
    """See docs/interfaces.md."""

    def __init__(self) -> None:
        super().__init__(RobotParams)

    def _make_transport(self) -> RobotTransport:
        made = RobotTransport(self, self.params, self, self._on_problem, self._keeps_up)
        pacer = Pacer(made.station, self.params)
        pacer.on_slowed = self._on_slowed
        self.core.pace = pacer
        self.core.unfit = lambda: '' if made.simulated else self._late(made.driver.timing)
        self.get_logger().info(f'where a drive is too weak, segments are timed by {pacer.by}')
        return made

    def _late(self, timing: Timing) -> str:
        """Why a robot that answers so late should get no arc; below the limit it is told."""
        if told := timing.told():
            self.core.notice(WARNING, 'link', f'robot: {told}')
        return timing.problem()

    def _keeps_up(self, now_us: int) -> bool:
        with self._lock:
            return not self.core.arming.waits(now_us)

    def _on_slowed(self, slowed: Slowed) -> None:
        with self._lock:
            self.core.notice(INFO, 'link', f'robot: {slowed.text}')

    def _on_problem(self, text: str) -> None:
        with self._lock:
            faults.held(self.core, f'robot: {text}; the arc is cut')


def main() -> None:
    node_main(RobotBridgeNode)
