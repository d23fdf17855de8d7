"""Records every topic of the graph, hidden ones included, into the MCAP of a job."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray

from waam_msgs.srv import Record
from waam_node.deferred import Deferred, create_deferred_service
from waam_node.namesake import PROCESS
from waam_node.node import ERROR, OK, WARN, WaamNode
from waam_node.node import main as run_main
from waam_node.qos import EVENTS

from .bag_writer import BagError
from .choice import Choice
from .node_session import RecorderParams
from .node_thread import RecordingThread
from .request import Answer, Request

CLOSE_S = 10.0  # at most, when the node is ended without STOP
STUCK_S = 10.0  # a recording without progress for so long is stuck: the node stops its heartbeat
CODES = (
    *(Record.Request.START, Record.Request.STOP, Record.Request.SPLIT),
    *(Record.Request.PAUSE, Record.Request.RESUME),
)


class Recorder(WaamNode):
    """Answers heartbeats and requests; the recording itself is in `RecordingThread`."""

    def __init__(self) -> None:
        super().__init__('recorder', RecorderParams)
        Choice(self.params.exclude)  # a wrong expression is refused now, not at START
        clock = self.get_clock()
        self._recording = RecordingThread(
            self.context,
            self.params,
            lambda: clock.now().nanoseconds,
            self.get_parameter('use_sim_time').value,
            self.get_namespace(),
        )
        self._recording.start()
        self.create_timer(0.2, self._report, clock=self.steady)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, EVENTS)
        create_deferred_service(self, Record, '~/control', self._on_control)

    def _on_control(
        self, request: Record.Request, response: Record.Response
    ) -> Record.Response | Deferred:
        later = Deferred()

        def reply(answer: Answer) -> None:
            response.success, response.message = answer.success, answer.text
            response.messages, response.lost = answer.messages, answer.lost
            later.answer(response)

        try:
            if request.code not in CODES:
                raise BagError(f'code {request.code} is not one of 1..5')
            data = _custom_data(request)
            now = time.monotonic()
            self._recording.ask(Request(request.code, request.directory, data, reply, now))
            if request.code == Record.Request.START:
                self.get_logger().info(f'recording into {request.directory}')
        except BagError as e:
            response.success, response.message = False, str(e)
            return response
        return later

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for value in status.values:
                if value.key == PROCESS:
                    self._recording.alive(value.value)

    def _report(self) -> None:
        recording = self._recording
        recording.answer_late()
        if recording.failure is not None:
            raise recording.failure
        status = recording.status
        self.values = status.values
        if recording.stuck_s > STUCK_S:
            self.level = ERROR
            self.message = f'the recording has been stuck for {recording.stuck_s:.0f} s'
        elif status.error:
            self.level, self.message = ERROR, status.error
        elif not status.active:
            self.level, self.message = OK, 'ready'
        else:
            self.level = WARN if status.lost else OK
            self.message = 'paused' if status.paused else 'recording'

    def responsive(self) -> bool:
        """False once the recording thread has been stuck for STUCK_S; the supervisor then sees a node that hangs."""
        return self._recording.stuck_s <= STUCK_S

    def close(self) -> None:
        """Finishes the recording when the node is ended without STOP."""
        if not self._recording.close(CLOSE_S):
            self.get_logger().error(f'the recording could not be closed within {CLOSE_S:.0f} s')


def _custom_data(request: Record.Request) -> dict[str, str]:
    """key=value of a START. Raises BagError."""
    if request.code != Record.Request.START:
        return {}
    if not request.directory:
        raise BagError('directory is empty')
    pairs = [item.partition('=') for item in request.custom_data]
    if bad := [key for key, separator, _ in pairs if not separator]:
        raise BagError(f"custom_data '{bad[0]}' is not of the form key=value")
    return {key: value for key, _, value in pairs}


def main() -> None:
    run_main(Recorder)
