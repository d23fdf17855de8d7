"""The executable `robot_bridge`: the node `bridge` with a robot behind it. Topics, services and lease are the same."""

from __future__ import annotations

from waam_bridge import faults
from waam_bridge.bridge_node import BridgeNode
from waam_bridge.frame_tree import Placed
from waam_bridge.node_frames import FramePublishers
from waam_bridge.outbox import INFO, WARNING
from waam_node.node import main as node_main

from .description import description, fixed_frames
from .node_transport import RobotTransport
from .pace import Pacer, Slowed
from .params import RobotParams
from .timing import Timing


class Robot:
    """The arm and its positioner, by the joint states of their driver."""

    drives = True

    def __init__(self, params: RobotParams, transport: RobotTransport) -> None:
        self._driver, self._names = transport.driver, params.joint_names
        self._text = description(params, transport.station)
        self._fixed = fixed_frames(transport.station)

    def urdf(self) -> str:
        """Known from the start."""
        return self._text

    def fixed(self) -> list[Placed]:
        """Machine and wire tip."""
        return self._fixed

    def joints(self) -> tuple[int, dict[str, float]] | None:
        """Of the newest complete joint state."""
        state = self._driver.state(self._driver.newest_us)
        if state is None:
            return None
        return state.time_us * 1000, dict(zip(self._names, state.joints.tolist(), strict=True))


class RobotBridgeNode(BridgeNode):
    """See docs/interfaces.md."""

    def __init__(self) -> None:
        super().__init__(RobotParams)

    def _make_transport(self) -> RobotTransport:
        made = RobotTransport(self, self.params, self, self._on_problem, self._keeps_up)
        pacer = Pacer(made.station, self.params)
        pacer.on_slowed = self._on_slowed
        self.core.pace = pacer
        self.core.unfit = lambda: (
            made.driver.scaled or ('' if made.simulated else self._late(made.driver.timing))
        )
        self.get_logger().info(f'where a drive is too weak, segments are timed by {pacer.by}')
        return made

    def _make_frames(self) -> FramePublishers:
        assert isinstance(self.transport, RobotTransport)
        return FramePublishers(self, self.core, Robot(self.params, self.transport))

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
