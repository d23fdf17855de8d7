"""The effective parameters of other nodes, read over their parameter services: part of what a job traces."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.parameter import parameter_value_to_python

from waam_node.node import CallError, WaamNode, call

NODES = ('scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'bridge')
ATTEMPTS = 2  # the first answer of a node that has just come up may be lost


class ParameterReader:
    """Call `read` from a thread that is not the executor's."""

    def __init__(self, node: WaamNode, names: tuple[str, ...] = NODES) -> None:
        self._clients = {
            name: (
                node.create_client(ListParameters, f'{name}/list_parameters'),
                node.create_client(GetParameters, f'{name}/get_parameters'),
            )
            for name in names
        }

    def read(self, timeout: float = 2.0) -> dict[str, dict[str, Any]]:
        """{node: {parameter: value}}; a node that does not answer within `timeout` s, twice, is left out."""
        found = {}
        for name, (listing, getting) in self._clients.items():
            for _ in range(ATTEMPTS):
                try:
                    found[name] = _of(listing, getting, timeout)
                    break
                except CallError:
                    continue
        return found


def _of(listing: Client, getting: Client, timeout: float) -> dict[str, Any]:
    names = call(listing, ListParameters.Request(), timeout).result.names
    values = call(getting, GetParameters.Request(names=names), timeout).values
    pairs = zip(names, values, strict=True)
    return {n: _plain(parameter_value_to_python(v)) for n, v in pairs}


def _plain(value: Any) -> Any:
    """Arrays become lists: the value goes into YAML."""
    return (
        list(value) if hasattr(value, '__len__') and not isinstance(value, str | bytes) else value
    )
