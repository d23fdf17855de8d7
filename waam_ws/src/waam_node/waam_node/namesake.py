"""A node whose name is taken ends: of two by one name nobody can say which one answers."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.subscription import Subscription

from .qos import EVENTS

PROCESS = 'process'  # key in /diagnostics: the process that a node lives in, `<name>@<host>:<pid>:<random>`
UP = 'up'  # key in /diagnostics: s of steady time since the node began
# s in which a new node looks for another one. Longer than a living one is silent, and than it takes to find it
YOUNG_S = 15.0


class NamesakeError(RuntimeError):
    """Another node lives by this name; the text says where."""


class Namesake:
    """Call `look` once a second; process: of the node. One that was killed stays in the graph until the middleware
    notices; so only another node that speaks counts, and the younger of the two ends."""

    def __init__(self, node: Node, process: str) -> None:
        self._node, self._process, self._began = node, process, time.monotonic()
        self._listening: Subscription | None = None

    @property
    def up(self) -> float:
        """s since the node began."""
        return time.monotonic() - self._began

    def look(self) -> None:
        """Listens for the other one as soon as the graph has the name twice; never again once the node is old."""
        if self.up > YOUNG_S:
            if self._listening is not None:
                self._node.destroy_subscription(self._listening)
                self._listening = None
            return
        same = (self._node.get_name(), self._node.get_namespace())
        twice = self._node.get_node_names_and_namespaces().count(same) > 1
        if twice and self._listening is None:
            self._listening = self._node.create_subscription(
                DiagnosticArray, '/diagnostics', self._on_diagnostics, EVENTS
            )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """NamesakeError when an older node by this name speaks."""
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            other = values.get(PROCESS, '')
            name, _, place = other.partition('@')
            if name != self._node.get_name() or other == self._process:
                continue
            if older(values.get(UP, ''), other, self.up, self._process):
                host, pid, _ = place.rsplit(':', 2)
                raise NamesakeError(
                    f'a node called {name} runs already: process {pid} on {host}; '
                    'end it, or use another ROS_DOMAIN_ID'
                )


def older(other_up: str, other: str, up: float, own: str) -> bool:
    """Whether the other node began before this one; of two that began within a second the name decides. ups: s."""
    try:
        ahead = float(other_up) - up
    except ValueError:
        return False
    return ahead > 1.0 or (ahead > -1.0 and other < own)
