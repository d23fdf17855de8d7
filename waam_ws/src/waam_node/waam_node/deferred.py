"""Services that answer later, so that no callback blocks.

The events executor of the pinned wheels cannot run coroutine callbacks. It answers with what the callback returned, by
`Service.send_response(response, header)`: a callback may return a `Deferred` instead of a response, and the header is
kept with it until `answer` is called, from any thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.node import Node


class Deferred:
    """Joins an answer and the way to send it, whichever comes first. `answer` is to be called exactly once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._response: Any = None
        self._send: Callable[[Any], None] | None = None

    def answer(self, response: Any) -> None:
        """Sends the response, at once or as soon as the service has handed over how to send it. Thread-safe."""
        with self._lock:
            self._response = response
            send = self._send
        if send:
            send(response)

    def bind(self, send: Callable[[Any], None]) -> None:
        """Called once, with what sends the response."""
        with self._lock:
            self._send = send
            response = self._response
        if response is not None:
            send(response)


def create_deferred_service(
    node: Node, kind: type, name: str, callback: Callable[[Any, Any], Any]
) -> Any:
    """Like `node.create_service`, for a `callback(request, response)` that returns a response or a `Deferred`."""
    service = node.create_service(kind, name, callback)
    send = service.send_response

    def send_or_keep(response: Any, header: Any) -> None:
        if isinstance(response, Deferred):
            response.bind(lambda late: send(late, header))
        else:
            send(response, header)

    service.send_response = send_or_keep  # type: ignore[method-assign]
    return service
