"""Records every topic of the graph, hidden ones included, into the MCAP of a job."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from waam_msgs.srv import Record
from waam_node.deferred import Deferred, create_deferred_service
from waam_node.node import ERROR, OK, WARN, WaamNode
from waam_node.node import main as run_main

from .bag_writer import BagError
from .node_session import RecorderParams, Session

IN_FLIGHT_S = 0.1  # STOP waits this long for messages that are on their way
CLOSE_S = 10.0  # at most, when the node is ended without STOP


class Recorder(WaamNode):
    def __init__(self) -> None:
        super().__init__('recorder', RecorderParams)
        p = self.params
        self._session: Session | None = None
        self._waiting: Callable[[], bool] | None = None
        self._simulated = self.get_parameter('use_sim_time').value
        self.create_timer(p.poll_period, self._drain, clock=self.steady)
        self.create_timer(p.discovery_period, self._discover, clock=self.steady)
        self.create_timer(0.02, self._progress, clock=self.steady)
        self.create_timer(1.0, self._report, clock=self.steady)
        create_deferred_service(self, Record, '~/control', self._on_control)
        if p.directory:
            self._begin(p.directory, {})

    def _on_control(
        self, request: Record.Request, response: Record.Response
    ) -> Record.Response | Deferred:
        actions = {
            Record.Request.START: self._start,
            Record.Request.STOP: self._stop,
            Record.Request.SPLIT: self._split,
            Record.Request.PAUSE: self._pause,
            Record.Request.RESUME: self._pause,
        }
        try:
            if self._waiting is not None:
                raise BagError('the request before this one is still at work')
            if request.code not in actions:
                raise BagError(f'code {request.code} is not one of 1..5')
            if request.code != Record.Request.START and self._session is None:
                raise BagError('nothing is being recorded')
            return actions[request.code](request, response)
        except (BagError, OSError) as e:
            response.success, response.message = False, str(e)
            return response

    def _start(self, request: Record.Request, response: Record.Response) -> Deferred:
        """Answers when the publishers known now are connected, so that nothing after the answer is missed."""
        if self._session is not None:
            raise BagError(
                f'{self._session.recording.directory} is being recorded; stop that first'
            )
        if not request.directory:
            raise BagError('directory is empty')
        pairs = [item.partition('=') for item in request.custom_data]
        if bad := [key for key, separator, _ in pairs if not separator]:
            raise BagError(f"custom_data '{bad[0]}' is not of the form key=value")
        self._begin(request.directory, {key: value for key, _, value in pairs})
        later, now = Deferred(), time.monotonic()
        give_up, settled = now + self.params.match_timeout, now + self.params.settle

        def ready() -> bool:
            nonlocal settled
            now, taps = time.monotonic(), self._session.taps
            if self._session.discover() or (taps.unmatched() and now < give_up):
                settled = now + self.params.settle
            if now < settled:
                return False
            missing = ', '.join(taps.unmatched())
            text = f'; not connected yet: {missing}' if missing else ''
            later.answer(self._fill(response, f'recording {len(taps.taps)} topics{text}'))
            return True

        self._waiting = ready
        return later

    def _stop(self, request: Record.Request, response: Record.Response) -> Deferred:
        later, arrived = Deferred(), time.monotonic() + IN_FLIGHT_S
        asked = False

        def closed() -> bool:
            nonlocal asked
            if time.monotonic() < arrived:
                return False
            if not asked:
                self._drain()
                self._session.stop()
                asked = True
            if not self._session.recording.finished:
                return False
            later.answer(self._fill(response, *self._session.summary()))
            self._end()
            return True

        self._waiting = closed
        return later

    def _split(self, request: Record.Request, response: Record.Response) -> Record.Response:
        self._drain()
        self._session.recording.split()
        return self._fill(response, 'next file')

    def _pause(self, request: Record.Request, response: Record.Response) -> Record.Response:
        self._drain()
        self._session.paused = request.code == Record.Request.PAUSE
        return self._fill(response, 'paused' if self._session.paused else 'recording')

    def _fill(self, response: Record.Response, text: str, success: bool = True) -> Record.Response:
        response.success, response.message = success, text
        response.messages, response.lost = self._session.recording.messages, self._session.lost
        return response

    def _begin(self, directory: str, custom_data: dict[str, str]) -> None:
        self._session = Session(
            self.context, Path(directory), custom_data, self.params, self._simulated
        )
        self.get_logger().info(f'recording into {directory}')

    def _end(self) -> None:
        self._session.close()
        self._session = None

    def _discover(self) -> None:
        if self._session is not None:
            self._session.discover()

    def _drain(self) -> None:
        if self._session is not None:
            self._session.drain(self.get_clock().now().nanoseconds)

    def _progress(self) -> None:
        if self._waiting is not None and self._waiting():
            self._waiting = None

    def _report(self) -> None:
        if self._session is None:
            self.level, self.message, self.values = OK, 'ready', {}
            return
        recording, taps = self._session.recording, self._session.taps
        self.values = {
            'directory': recording.directory,
            'topics': len(taps.taps),
            'skipped': ', '.join(taps.skipped),
            'messages': recording.messages,
            'lost': taps.lost,
            'dropped': sum(recording.dropped),
            'waiting_bytes': recording.waiting_bytes,
            **self._session.losses(),
        }
        if recording.error:
            self.level, self.message = ERROR, recording.error
        else:
            self.level = WARN if self._session.lost else OK
            self.message = 'paused' if self._session.paused else 'recording'

    def close(self) -> None:
        """Finishes the recording when the node is ended without STOP."""
        if self._session is not None:
            self._drain()
            self._session.stop()
            if not self._session.recording.wait(CLOSE_S):
                self.get_logger().error(f'the recording could not be closed within {CLOSE_S:.0f} s')
            self._end()


def main() -> None:
    run_main(Recorder)
