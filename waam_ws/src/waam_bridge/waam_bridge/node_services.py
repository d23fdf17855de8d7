"""The services of the bridge. Answers of `command` are sent later, from the link's thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import RLock

from rclpy.node import Node
from std_srvs.srv import SetBool

from waam_msgs.srv import Command, Enqueue
from waam_node.conversions import segment_from_msg
from waam_node.deferred import Deferred, create_deferred_service

from . import commands, program, requests
from .core import Bridge
from .program import Refusal


class Services:
    """`lock` guards the core; `pump` writes and publishes the results of a request; `at_once` puts real-time bytes on
    the wire and waits for no lock."""

    def __init__(
        self,
        node: Node,
        core: Bridge,
        lock: RLock,
        pump: Callable[[], None],
        at_once: Callable[[bytes], str],
    ) -> None:
        self._node, self._core, self._lock, self._pump = node, core, lock, pump
        self._at_once = at_once
        node.create_service(Enqueue, '~/enqueue', self._on_enqueue)
        create_deferred_service(node, Command, '~/command', self._on_command)

    def offer_accelerometer(self) -> None:
        """There is an accelerometer: the service that switches it."""
        create_deferred_service(self._node, SetBool, 'accelerometer/enable', self._on_accelerometer)

    def _on_accelerometer(self, request: SetBool.Request, response: SetBool.Response) -> Deferred:
        later = Deferred()

        def answer(code: int, text: str) -> None:
            response.success, response.message = code == requests.OK, text
            later.answer(response)

        with self._lock:
            accelerometer = self._core.accelerometer
            accelerometer.switch(self._core, request.data, answer, time.monotonic())
        self._pump()
        return later

    def _on_enqueue(self, request: Enqueue.Request, response: Enqueue.Response) -> Enqueue.Response:
        """Checks outside the lock, so that a large batch does not hold up the link."""
        try:
            segments = [segment_from_msg(m) for m in request.segments]
            with self._lock:
                permit = self._core.permit(request.job_id, segments)
            batch = program.prepare(permit, segments, request.last)
            with self._lock:
                self._core.commit(permit, batch)
            response.accepted, response.duplicates = batch.accepted, batch.duplicates
            self._pump()
        except ValueError as e:
            response.error_code, response.message = _code(e), str(e)
        return response

    def _on_command(self, request: Command.Request, response: Command.Response) -> Deferred:
        later = Deferred()

        def answer(code: int, text: str) -> None:
            response.error_code, response.message = code, text
            later.answer(response)

        v = request.vector
        command = commands.Command(
            request.code, request.text, tuple(request.names), (v.x, v.y, v.z), request.value
        )
        if command.code in commands.REAL_TIME:
            self._at_once(commands.REAL_TIME[command.code])
        with self._lock:
            commands.run(self._core, command, answer, time.monotonic())
        self._pump()
        return later


def _code(error: ValueError) -> int:
    """Of a refusal its own; anything else is wrong with a segment."""
    return error.code if isinstance(error, Refusal) else program.BAD_SEGMENT
