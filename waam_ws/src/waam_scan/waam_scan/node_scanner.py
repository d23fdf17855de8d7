"""Switches the scanner on and off through its service, without blocking."""

from __future__ import annotations

import time

from std_srvs.srv import SetBool

from waam_node.node import WaamNode

from .node_waiting import Event, after, first


class ScannerSwitch:
    """Client of `scanner/enable`. wait: s for the service to be there; answer: s for its answer (steady time)."""

    def __init__(self, node: WaamNode, wait: float, answer: float) -> None:
        self._node, self._wait, self._answer = node, wait, answer
        self._client = node.create_client(SetBool, 'scanner/enable')

    async def set(self, on: bool) -> str:
        """Returns '' when the scanner obeyed, else what is wrong."""
        name, end = self._client.srv_name, time.monotonic() + self._wait
        while not self._client.service_is_ready():
            if time.monotonic() > end:
                return f'no scanner: service {name} is not there (waited {self._wait:.1f} s)'
            await after(self._node, 0.02)
        future = self._client.call_async(SetBool.Request(data=on))
        answer = await first(Event.of(future), after(self._node, self._answer))
        if answer is None:
            self._client.remove_pending_request(future)
            return f'no scanner: service {name} did not answer within {self._answer:.1f} s'
        return '' if answer.success else f'the scanner refused: {answer.message}'
