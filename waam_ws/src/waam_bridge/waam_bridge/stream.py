"""The sender of queued lines: window, cumulative acknowledgement, resending, and what each line stands for.

Pure: time is an argument (s, any steady clock). The receiver drops whatever does not follow in order, so this is
go-back-N. Line numbers are never used twice on one controller, so an old answer cannot be taken for a new one.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from typing import Any

from . import frames

RESERVE = 200  # bytes of the receive buffer that are left to heartbeats and other immediate lines
BACKOFF_MAX = 2.0  # s
REPEAT = 0.02  # s, above a round trip: requests for one line within it come from the same gap


class Sender:
    """Lines wait here until the controller has them; marks wait until it has executed them.

    `put` appends, `poll` returns the bytes that may be written now, and `ack`, `resend` and `executed`
    take what the controller says. While `blocked` (after a refused line, a stop or a lost link) nothing is sent
    until `resync`.
    """

    def __init__(self, timeout: float = 0.2, window: int = 65535) -> None:
        self.timeout = timeout  # s without progress after which the oldest line is sent again
        self.window = window  # most bytes under way
        self.digits = frames.CRC16  # of the check of every line
        self.acked = 0  # last line in the controller's queue
        self.next = 1  # number of the next line to be put
        self.blocked = True
        self.lines_sent = self.acknowledged = 0
        self.resends = 0
        self._cursor = 1  # number of the next line to be written
        self._high = 0  # largest number ever written
        self._lines: deque[bytes] = deque()  # G-code of line acked + 1 and following
        self._marks: deque[tuple[int, Any]] = deque()  # (line, what is done once it is executed)
        self._blocks = self._room = self._rx = 0
        self._flight = 0  # bytes written and not acknowledged
        self._progress = 0.0  # s, when something was last acknowledged or first written
        self._backoff = timeout
        self._rewound = (0, -1e9)  # (line, s) of the last resending on request
        self._probe = 0  # line that was sent again because of silence

    @property
    def pending(self) -> int:
        """Lines that the controller has not acknowledged."""
        return len(self._lines)

    @property
    def written(self) -> int:
        """Largest line number that was ever written to this controller."""
        return self._high

    @property
    def room(self) -> int:
        """Bytes that may be written now."""
        return self._room - self._flight

    @property
    def oldest_mark(self) -> Any:
        """Mark of the line that is executed next, or None."""
        return self._marks[0][1] if self._marks else None

    @property
    def unsent(self) -> int:
        """Marks whose line was not written yet."""
        return len(self._marks) - bisect_left(self._marks, self._cursor, key=lambda m: m[0])

    @property
    def in_flight(self) -> int:
        """Lines that were written and are not acknowledged."""
        return self._cursor - 1 - self.acked

    @property
    def marks(self) -> int:
        """Marks that were not executed."""
        return len(self._marks)

    def put(self, gcode: bytes, mark: Any = None) -> int:
        """Appends a line; returns its number. `mark` comes back from `executed`."""
        seq = self.next
        self._lines.append(gcode)
        if mark is not None:
            self._marks.append((seq, mark))
        self.next += 1
        return seq

    def resync(self, first: int, blocks: int, rx: int, now: float) -> None:
        """The controller expects line `first` and has room: lines from there on are sent (again)."""
        if self._lines and self.acked + 1 < first:
            self._accept(first - 1, now)
        if not self._lines:
            self.next = first
        self.acked = first - 1
        self._cursor, self._flight = first, 0
        self._high = max(self._high, self.acked)
        self._rx = self._room = min(rx - RESERVE, self.window)
        self._blocks = blocks
        self._progress, self._backoff, self._probe = now, self.timeout, 0
        self.blocked = False

    def restart(self) -> None:
        """Another controller, or the same one after a restart: numbers start again, nothing is kept."""
        self._lines.clear()
        self._marks.clear()
        self.acked = self._high = self._flight = 0
        self.next = self._cursor = 1
        self.blocked = True

    def drop(self, keep: int = 0) -> int:
        """Forgets all lines, and the marks beyond line `keep`; returns how many marks were lost.

        Needs `resync(self.acked + 1)` afterwards.
        """
        before = len(self._marks)
        self._marks = deque(m for m in self._marks if m[0] <= keep)
        self._lines.clear()
        self.acked = max(self._high, self.acked)
        self._cursor = self.next = self.acked + 1
        self._flight = 0
        self.blocked = True
        return before - len(self._marks)

    def ack(self, seq: int, blocks: int, room: int | None, now: float) -> None:
        """Everything up to `seq` is accepted. `room`: free bytes then, None when not reported (telemetry)."""
        if self.blocked or seq > self._high or seq < self.acked:
            return
        if seq > self.acked:
            self._accept(seq, now)
        self._blocks = blocks
        if room is not None:
            self._room = min(room - RESERVE, self.window)
        if self._probe and self._probe == seq and self.in_flight:
            self._rewind(seq + 1)
        if self._probe <= seq:
            self._probe = 0

    def _accept(self, seq: int, now: float) -> None:
        for n in range(self.acked + 1, seq + 1):
            line = self._lines.popleft()
            if n < self._cursor:
                self._flight -= self._size(n, line)
        self.acknowledged += seq - self.acked
        self.acked = seq
        self._cursor = max(self._cursor, seq + 1)
        self._progress, self._backoff = now, self.timeout

    def resend(self, expected: int, now: float) -> None:
        """The controller misses line `expected`. Repeated requests that one gap causes are answered once."""
        if self.blocked or not self.acked < expected < self._cursor:
            return
        line, when = self._rewound
        if line == expected and now - when < REPEAT:
            return
        self._rewound = (expected, now)
        self._rewind(expected)

    def _rewind(self, seq: int) -> None:
        """Lines from `seq` on are written again as the window allows."""
        while self._cursor > seq:
            self._cursor -= 1
            self._flight -= self._size(self._cursor, self._lines[self._cursor - self.acked - 1])

    def executed(self, seq: int) -> list[Any]:
        """Marks of all lines up to `seq`, in order; each comes out once."""
        done = []
        while self._marks and self._marks[0][0] <= seq:
            done.append(self._marks.popleft()[1])
        return done

    def _size(self, seq: int, gcode: bytes) -> int:
        """Bytes of the sealed line."""
        return len(gcode) + len(str(seq)) + 4 + self.digits

    def poll(self, now: float) -> bytes:
        """What may be written now."""
        if self.blocked or not self._lines:
            return b''
        if self.in_flight and now - self._progress > self._backoff:
            return self._repeat_oldest(now)
        return self._fill_window(now)

    def _repeat_oldest(self, now: float) -> bytes:
        self._progress = now
        self._backoff = min(2 * self._backoff, BACKOFF_MAX)
        self._probe = self.acked + 1
        self.resends += 1
        return frames.queued(self._probe, self._lines[0], self.digits)

    def _fill_window(self, now: float) -> bytes:
        flight = self.in_flight
        if flight == 0:
            self._progress, self._room = now, self._rx
        out = bytearray()
        while flight < self._blocks and flight < len(self._lines):
            line = self._lines[flight]
            size = self._size(self._cursor, line)
            if self._flight + size > self._room:
                break
            out += frames.queued(self._cursor, line, self.digits)
            self.lines_sent += 1
            if self._cursor <= self._high:
                self.resends += 1
            self._high = max(self._high, self._cursor)
            self._cursor += 1
            self._flight += size
            flight += 1
        return bytes(out)
