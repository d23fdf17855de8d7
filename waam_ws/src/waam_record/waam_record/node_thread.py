"""The thread that a recording runs in. Whatever it waits for, the node's heartbeat and services go on.

Subscribing to a hundred topics takes a second on a busy core; creating and syncing a file takes as long as the
disk needs. The node only hands over requests and reads the newest `Status`.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path

from rclpy.context import Context

from waam_msgs.srv import Record

from .bag_writer import BagError
from .node_session import RecorderParams, Session
from .recording import Recording
from .request import Answer, Request, Status

IN_FLIGHT_S = 0.1  # STOP waits this long for messages that are on their way
POLL_S = 0.02  # between two looks into the subscriptions
DISCOVERY_S = 1.0  # between two looks for new topics
CLOSE_S = 20.0  # STOP answers after this long at the latest; a slow disk then goes on by itself
STATUS_S = 1.0  # time between two looks at the state of the recording
MATCH_S = 2.0  # START waits this long for the known publishers to connect
SETTLE_S = 0.25  # START answers this long after the last one connected
START_S = 20.0  # START that has not begun to record by then has failed, and leaves nothing behind
CLIENT_SILENT_S = 15.0  # steady time without a sign of life of the client that ends its recording
NOT_BEGUN = 'it was stopped before it had begun'
CLIENT = 'client'  # key of START's custom_data: the process (`waam_node.node.WaamNode.process`) that it records for


class RecordingThread:
    """Owns the session and everything it subscribes to. `ask`, `alive`, `answer_late`, `status`, `stuck_s` and `close`
    are for other threads.

    ros_now_ns: ROS time in ns, 0 = not known yet; simulated: messages are filed under it; namespace: of the cell.
    """

    def __init__(
        self,
        context: Context,
        params: RecorderParams,
        ros_now_ns: Callable[[], int],
        simulated: bool,
        namespace: str = '/',
    ) -> None:
        self._context, self._params, self._namespace = context, params, namespace
        self._ros_now_ns, self._simulated = ros_now_ns, simulated
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._open: list[Request] = []  # asked and not done with, the oldest first
        self._lock = threading.Lock()  # guards `_open`
        self._current: Request | None = None
        self._session: Session | None = None
        self._ended: Session | None = None  # the one that was stopped last
        self._unfinished: Callable[[], bool] | None = None  # of a request that is not answered yet
        self._closing: list[Recording] = []  # stopped, still being written
        self._ending = threading.Event()
        self._client = ''  # process that the session records for, '' = ends with STOP alone
        self._client_silent = 0.0  # s of steady time
        self._looked = self._progressed = time.monotonic()
        self._why = ''  # why the last recording ended without STOP
        self.status = Status()
        self.failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name='recording', daemon=True)

    def start(self) -> None:
        """Begins to wait for requests."""
        self._progressed = time.monotonic()
        self._thread.start()

    # ---- for other threads

    def ask(self, request: Request) -> None:
        """Hands a request over. STOP is taken in every state, and ends a START that is still at work; anything else
        raises BagError while a request before it is unfinished."""
        with self._lock:
            if request.code == Record.Request.STOP:
                for started in self._open:
                    started.cancelled |= request.concerns(started.directory)
            elif self._open:
                raise BagError('the request before this one is still at work')
            self._open.append(request)
        self._requests.put(request)

    def alive(self, process: str) -> None:
        """A sign of life of a process that may be the client of the recording."""
        if process == self._client:
            self._client_silent = 0.0

    def answer_late(self) -> None:
        """Answers what disk or graph keep this thread from answering; its work goes on, a START's is undone."""
        now = time.monotonic()
        with self._lock:
            waiting = list(self._open)
        for request in waiting:
            late = now - request.asked
            if request.code != Record.Request.START:
                if late > CLOSE_S + 1.0:
                    text = 'the disk does not answer; it is done when it does'
                    request.answer(Answer(False, text))
            elif late > START_S:
                request.cancelled = True
                text = f'recording had not begun after {late:.0f} s: given up (slow disk or graph)'
                request.answer(Answer(False, text))

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
            self._end('the recorder was ended')
        return all(r.wait(max(0.0, end - time.monotonic())) for r in self._closing)

    # ---- the thread itself

    def _run(self) -> None:
        look = report = 0.0
        try:
            while not self._ending.is_set():
                self._on_progress()
                self._serve()
                now = time.monotonic()
                self._look_at_client(now)
                if now >= look:
                    look = now + DISCOVERY_S
                    self._discover()
                self._drain()
                if now >= report:
                    report = now + STATUS_S
                    self.status = self._look()
        except Exception as e:  # the node ends with it
            self.failure = e

    def _on_progress(self) -> None:
        self._progressed = time.monotonic()
        if self._current is not None and self._current.cancelled:
            raise BagError(NOT_BEGUN)

    def _serve(self) -> None:
        """Continues the current request, or takes the next one; waits one poll period for it."""
        if self._unfinished is not None:
            time.sleep(POLL_S)
            if self._unfinished():
                self._unfinished = None
            return
        try:
            request = self._requests.get(timeout=POLL_S)
        except queue.Empty:
            return
        try:
            self._unfinished = self._take(request)
        except (BagError, OSError) as e:
            self._answer(request, Answer(False, str(e)))
        finally:
            self._current = None

    def _answer(self, request: Request, answer: Answer) -> bool:
        """False when `answer_late` has answered before."""
        self.status = self._look()
        with self._lock:  # first: whoever has the answer may ask again
            self._open.remove(request)
        return request.answer(answer)

    def _take(self, request: Request) -> Callable[[], bool] | None:
        """Starts a request. Returns a function to call until it reports that it has answered."""
        if request.code == Record.Request.START:
            return self._start(request)
        if request.code == Record.Request.STOP:
            return self._stop(request)
        if self._session is None:
            raise BagError('nothing is being recorded')
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
        """Answers when the publishers known now are connected, so that nothing after the answer is missed. For the
        folder that is being recorded it answers again."""
        session = self._session
        if session is not None and self._started_again(request, session):
            self._end(f'{self._client} was started again')
            session = None
        if session is None:
            self._current = request
            session = self._begin(request.directory, request.custom_data)
        elif not request.concerns(session.directory):
            raise BagError(f'{session.directory} is being recorded; stop that first')
        now = time.monotonic()
        give_up, settled = now + MATCH_S, now + SETTLE_S

        def ready() -> bool:
            nonlocal settled
            now, taps = time.monotonic(), session.taps
            if request.cancelled:
                self._end(NOT_BEGUN)
                self._answer(request, Answer(False, NOT_BEGUN))
                return True
            if session.discover() or (taps.unmatched() and now < give_up):
                settled = now + SETTLE_S
            if now < settled:
                return False
            missing = ', '.join(taps.unmatched())
            text = f'; not connected yet: {missing}' if missing else ''
            if not self._answer(
                request, _about(session, f'recording {len(taps.taps)} topics{text}')
            ):
                self._end(NOT_BEGUN)  # its client has been told that it failed
            return True

        return ready

    def _started_again(self, request: Request, session: Session) -> bool:
        """Whether the request for another folder comes from the node that the session records for, as another process:
        the one before has died, and nobody will ask for the end of its recording."""
        asks = request.custom_data.get(CLIENT, '')
        node, _, _ = self._client.partition('@')
        other = not request.concerns(session.directory) and asks != self._client
        return bool(node) and other and asks.partition('@')[0] == node

    def _stop(self, request: Request) -> Callable[[], bool] | None:
        """Answers when the files are closed and verified, or after CLOSE_S that they are not. One that is
        stopped already is answered again; one that is not recorded needs no STOP."""
        arrived = time.monotonic() + IN_FLIGHT_S
        give_up = arrived + CLOSE_S
        session = self._session
        if session is None or not request.concerns(session.directory):
            session = self._ended
            if session is None or not request.directory or not request.concerns(session.directory):
                what = f'{request.directory} is not' if request.directory else 'nothing is'
                self._answer(request, Answer(True, f'{what} being recorded'))
                return None
        stopped = session

        def closed() -> bool:
            now = time.monotonic()
            if stopped is self._session:
                if now < arrived:
                    return False
                self._end()
            if not stopped.recording.finished and now < give_up:
                return False
            self._answer(request, _about(stopped, *stopped.summary()))
            return True

        return closed

    def _begin(self, directory: str, custom_data: dict[str, str]) -> Session:
        self._why, self._client_silent = '', 0.0
        self._client = custom_data.get(CLIENT, '')
        self._session = Session(
            self._context,
            Path(directory),
            custom_data,
            self._params,
            self._simulated,
            self._on_progress,
            self._namespace,
        )
        try:
            self._session.discover()
        except Exception as e:
            self._end(str(e))
            raise
        return self._session

    def _end(self, why: str = '') -> None:
        """No message is taken any more, and the files are closed as soon as the disk can. why: without a STOP."""
        session = self._session
        if session is None:
            return
        self._drain()
        session.stop(why)
        self._closing.append(session.recording)
        session.close()
        self._session, self._ended, self._why = None, session, why

    def _look_at_client(self, now: float) -> None:
        """Ends a recording whose client has died. A second at most counts per look: this process may have slept."""
        self._client_silent += min(now - self._looked, 1.0)
        self._looked = now
        if self._session is None or not self._client or self._unfinished is not None:
            return
        if self._client_silent > CLIENT_SILENT_S:
            self._end(f'{self._client} gave no sign of life for {CLIENT_SILENT_S:.0f} s')

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
            closing = {'closing': ', '.join(late)} if late else {}
            why = self._why and f'recording ended: {self._why}'
            return Status(error=why, values=closing)
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
