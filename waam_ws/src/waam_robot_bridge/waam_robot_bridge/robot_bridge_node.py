"""The executable `robot_bridge`: the node `bridge` with a robot behind it. Topics, services and lease are the same."""

from __future__ import annotations

from waam_bridge.bridge_node import BridgeNode
from waam_bridge.outbox import FAULT
from waam_node.node import main as node_main

from .node_transport import RobotTransport
from .params import RobotParams


class RobotBridgeNode(BridgeNode):
    """See docs/interfaces.md."""

    def __init__(self) -> None:
        super().__init__(RobotParams)

    def _make_transport(self) -> RobotTransport:
        return RobotTransport(self, self.params, self, self._on_problem)

    def _on_problem(self, text: str) -> None:
        with self._lock:
            self.core.notice(FAULT, 'link', f'robot: {text}; the arc is cut', 'hold')


def main() -> None:
    node_main(RobotBridgeNode)
