"""The thread that a recording runs in. Whatever it waits for, the node's heartbeat and services go on.

Subscribing to a hundred topics takes a second on a busy core; creating and syncing a file takes as long as the
disk needs. The node only hands over requests and reads the newest `Status`.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rclpy.context import Context

from waam_msgs.srv import Record

from .bag_writer import BagError
from .node_session import RecorderParams, Session
from .recording import Recording

IN_FLIGHT_S = 0.1  # STOP waits this long for messages that are on their way
STATUS_S = 1.0  # time between two looks at the state of the recording


@dataclass(frozen=True)
class Answer:
    """Result of a request; messages and lost: of the recording that it concerned."""

    success: bool
    text: str
    messages: int = 0
    lost: int = 0


@dataclass(frozen=True)
class Status:
    """For the diagnostics."""

    active: bool = False  # something is being recorded
    paused: bool = False
    error: str = ''  # why recording ended early
    lost: int = 0
    values: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Request:
    """A call of record/control, for the thread of the recording."""

    code: int  # of Record.srv
    directory: str
    custom_data: dict[str, str]
    reply: Callable[[Answer], None]  # is called once, from the thread of the recording


class RecordingThread:
    """Owns the session and everything it subscribes to. `ask`, `status`, `stuck_s` and `close` are for other threads.

    ros_now_ns: ROS time in ns, 0 = not known yet; simulated: messages are filed under it.
    """

    def __init__(
        self,
        context: Context,
        params: RecorderParams,
        ros_now_ns: Callable[[], int],
        simulated: bool,
    ) -> None:
        self._context, self._params = context, params
        self._ros_now_ns, self._simulated = ros_now_ns, simulated
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._session: Session | None = None
        self._unfinished: Callable[[], bool] | None = None  # of a request that is not answered yet
        self._closing: list[Recording] = []  # stopped, still being written
        self._busy = threading.Lock()  # a request is in progress, from `ask` to the answer
        self._ending = threading.Event()
        self._progressed = time.monotonic()
        self.status = Status()
        self.failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name='recording', daemon=True)

    def start(self, directory: str = '') -> None:
        """Begins, with a recording when a directory is given. Raises BagError, OSError."""
        if directory:
            self._begin(directory, {})
        self._progressed = time.monotonic()
        self._thread.start()

    # ---- for other threads

    def ask(self, request: Request) -> None:
        """Hands a request over. Raises BagError while the one before is unfinished."""
        if not self._busy.acquire(blocking=False):
            raise BagError('the request before this one is still at work')
        self._requests.put(request)

    @property
    def stuck_s(self) -> float:
        """Time since the thread last made progress."""
        return time.monotonic() - self._progressed

    def close(self, timeout: float) -> bool:
        """Ends the thread and a recording that is still open; False when that took longer than `timeout`."""
        end = time.monotonic() + timeout
        self._ending.set()
        self._thread.join(timeout)
        if self._thread.is_alive():
            return False
        if self._session is not None:
            self._drain()
            self._session.stop()
            self._closing.append(self._session.recording)
        waits = [r.wait(max(0.0, end - time.monotonic())) for r in self._closing]
        self._end()
        return all(waits)

    # ---- the thread itself

    def _run(self) -> None:
        look = report = 0.0
        try:
            while not self._ending.is_set():
                self._on_progress()
                self._serve()
                now = time.monotonic()
                if now >= look:
                    look = now + self._params.discovery_period
                    self._discover()
                self._drain()
                if now >= report:
                    report = now + STATUS_S
                    self.status = self._look()
        except Exception as e:  # the node ends with it
            self.failure = e

    def _on_progress(self) -> None:
        self._progressed = time.monotonic()

    def _serve(self) -> None:
        """Continues the current request, or takes the next one; waits one poll period for it."""
        if self._unfinished is not None:
            time.sleep(self._params.poll_period)
            if self._unfinished():
                self._unfinished = None
            return
        try:
            request = self._requests.get(timeout=self._params.poll_period)
        except queue.Empty:
            return
        try:
            self._unfinished = self._take(request)
        except (BagError, OSError) as e:
            self._answer(request, Answer(False, str(e)))

    def _answer(self, request: Request, answer: Answer) -> None:
        self.status = self._look()
        self._busy.release()  # first: whoever has the answer may ask again
        request.reply(answer)

    def _take(self, request: Request) -> Callable[[], bool] | None:
        """Starts a request. Returns a function to call until it reports that it has answered."""
        if request.code == Record.Request.START:
            return self._start(request)
        if self._session is None:
            raise BagError('nothing is being recorded')
        if request.code == Record.Request.STOP:
            return self._stop(request, self._session)
        self._drain()
        if request.code == Record.Request.SPLIT:
            self._session.recording.split()
            text = 'next file'
        else:
            self._session.paused = request.code == Record.Request.PAUSE
            text = 'paused' if self._session.paused else 'recording'
        self._answer(request, _about(self._session, text))
        return None

    def _start(self, request: Request) -> Callable[[], bool]:
        """Answers when the publishers known now are connected, so that nothing after the answer is missed."""
        if self._session is not None:
            raise BagError(
                f'{self._session.recording.directory} is being recorded; stop that first'
            )
        session = self._begin(request.directory, request.custom_data)
        now = time.monotonic()
        give_up, settled = now + self._params.match_timeout, now + self._params.settle

        def ready() -> bool:
            nonlocal settled
            now, taps = time.monotonic(), session.taps
            if session.discover() or (taps.unmatched() and now < give_up):
                settled = now + self._params.settle
            if now < settled:
                return False
            missing = ', '.join(taps.unmatched())
            text = f'; not connected yet: {missing}' if missing else ''
            self._answer(request, _about(session, f'recording {len(taps.taps)} topics{text}'))
            return True

        return ready

    def _stop(self, request: Request, session: Session) -> Callable[[], bool]:
        """Answers when the files are closed and verified, or after `close_timeout` that they are not."""
        arrived = time.monotonic() + IN_FLIGHT_S
        give_up = arrived + self._params.close_timeout
        asked = False

        def closed() -> bool:
            nonlocal asked
            now = time.monotonic()
            if now < arrived:
                return False
            if not asked:
                self._drain()
                session.stop()
                self._closing.append(session.recording)
                asked = True
            if not session.recording.finished and now < give_up:
                return False
            self._session = None
            self._answer(request, _about(session, *session.summary()))
            session.close()
            return True

        return closed

    def _begin(self, directory: str, custom_data: dict[str, str]) -> Session:
        self._session = Session(
            self._context,
            Path(directory),
            custom_data,
            self._params,
            self._simulated,
            self._on_progress,
        )
        return self._session

    def _end(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None

    def _discover(self) -> None:
        if self._session is not None:
            self._session.discover()

    def _drain(self) -> None:
        if self._session is not None:
            self._session.drain(self._ros_now_ns())

    def _look(self) -> Status:
        self._closing = [r for r in self._closing if not r.finished]
        late = [str(r.directory) for r in self._closing]
        if self._session is None:
            return Status(values={'closing': ', '.join(late)} if late else {})
        recording, taps = self._session.recording, self._session.taps
        values = {
            'directory': recording.directory,
            'topics': len(taps.taps),
            'skipped': ', '.join(taps.skipped),
            'messages': recording.messages,
            'lost': taps.lost,
            'dropped': sum(recording.dropped),
            'waiting_bytes': recording.waiting_bytes,
            **self._session.losses(),
        }
        return Status(True, self._session.paused, recording.error, self._session.lost, values)


def _about(session: Session, text: str, success: bool = True) -> Answer:
    return Answer(success, text, session.recording.messages, session.lost)
