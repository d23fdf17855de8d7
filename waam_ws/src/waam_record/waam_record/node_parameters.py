"""Asks every node of the graph for its effective parameters, so that a recording can be computed again with them."""

from __future__ import annotations

import json
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from .choice import is_below

# looks without an answer after which a node is asked again (a first answer can be lost)
PATIENCE = 5


class _Asked:
    """One node: its names, then its values."""

    def __init__(self, node: Node, name: str) -> None:
        self.lister = node.create_client(ListParameters, f'{name}/list_parameters')
        self.getter = node.create_client(GetParameters, f'{name}/get_parameters')
        self.names: list[str] | None = None
        self.text: str | None = None
        self._future, self._looks = None, 0

    def advance(self) -> None:
        """One step, without waiting."""
        if self._future is not None and self._future.done():
            result, self._future = self._future.result(), None
            if self.names is None:
                self.names = list(result.result.names)
            else:
                values = map(parameter_value_to_python, result.values)
                pairs = dict(zip(self.names, values, strict=False))
                self.text = json.dumps(pairs, sort_keys=True, default=str)
                return
        self._looks += 1
        if self._future is None or self._looks % PATIENCE == 0:
            self._ask()

    def _ask(self) -> None:
        if self.names is None:
            self._future = _call(self.lister, ListParameters.Request())
        else:
            self._future = _call(self.getter, GetParameters.Request(names=self.names))


def _call(client: Client, request: Any) -> Any:
    return client.call_async(request) if client.service_is_ready() else None


class ParameterReader:
    """Call `read` at any time; it never waits. A node of its own, so that nothing else is disturbed."""

    def __init__(self, context: Context, namespace: str = '/') -> None:
        self._namespace = namespace
        self._node = Node(
            '_recorder_parameters',
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._asked: dict[str, _Asked] = {}

    def read(self) -> dict[str, str]:
        """`parameters.<node>` with the parameters as JSON, of the nodes of the namespace that have answered so far."""
        for name, kinds in self._node.get_service_names_and_types():
            node, _, service = name.rpartition('/')
            known = node in self._asked or not is_below(node, self._namespace)
            if service == 'list_parameters' and not known and kinds:
                self._asked[node] = _Asked(self._node, node)
        for _ in range(4 * len(self._asked) if self._busy else 0):
            self._executor.spin_once(timeout_sec=0.0)
        for asked in self._asked.values():
            if asked.text is None:
                asked.advance()
        found = {n: a.text for n, a in self._asked.items() if a.text is not None}
        below = self._namespace.rstrip('/') + '/'
        return {f'parameters.{n.removeprefix(below)}': text for n, text in found.items()}

    @property
    def _busy(self) -> bool:
        return any(a.text is None for a in self._asked.values())

    def close(self) -> None:
        """Ends its executor and its node."""
        self._executor.shutdown()
        self._node.destroy_node()
