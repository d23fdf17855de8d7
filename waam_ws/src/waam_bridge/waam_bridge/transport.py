"""The serial port behind one small interface: whole lines come in, bytes go out, nothing ever blocks a caller."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import select
import threading
import time
from typing import Protocol

import serial

READ_BYTES = 65536
LINE_LIMIT = 4096  # bytes without a newline after which they are discarded
BACKLOG_LIMIT = 65536  # unwritten bytes after which the port is given up
RATES = (
    921600,
    115200,
    460800,
    230400,
)  # Bd, of a UART whose rate is to be found; the firmware's first
_PLAIN = {
    errno.ENOENT: 'there is no such port; is the controller switched on and plugged in?',
    errno.EACCES: 'no permission to open the port; is the user in its group (dialout)?',
    errno.EAGAIN: 'the port is in use by another program',
    errno.EIO: 'the other end hung up',
}


class Owner(Protocol):
    """Called from the transport's thread only."""

    def on_open(self) -> None:
        """The port is open."""

    def on_lines(self, lines: list[bytes], read_at: float) -> None:
        """Whole lines without their ends; read_at: s, steady clock."""

    def on_idle(self) -> None:
        """Called after every chunk of lines and while none come; the place to write what is due."""

    def on_close(self, reason: str) -> None:
        """The port was closed or could not be opened; it is tried again."""

    def on_crash(self, error: Exception) -> None:
        """A defect has ended the thread."""


class Transport(Protocol):
    """What a bridge needs of the way to its controller."""

    def start(self) -> None:
        """Starts the thread that opens it and calls the owner."""

    def close(self) -> None:
        """Ends the thread."""

    def reopen(self, reason: str) -> None:
        """Closes it and tries again, because of `reason`."""

    def write(self, data: bytes) -> None:
        """Never blocks; thread safe; without effect while it is closed."""

    def write_now(self, data: bytes) -> str:
        """As `write`, before all that waits, even within a line; '' or why it could not be written."""


class SerialTransport:
    """A port (tty, USB-CDC, pseudo-terminal) with one thread that reads, hands lines over and reopens it.

    `on_idle` is called after every chunk of lines and at least every `idle` seconds while the port is open. With a
    `baud` of 0 every opening tries the next of RATES.
    """

    def __init__(
        self, port: str, baud: int, owner: Owner, retry: float = 0.5, idle: float = 0.02
    ) -> None:
        self.port, self.owner = port, owner
        self._rates = itertools.cycle((baud,) if baud else RATES)
        self.retry, self.idle = retry, idle
        self._serial: serial.Serial | None = None
        self._fd = -1
        self._lock = threading.Lock()  # of the outgoing bytes and the descriptor
        self._backlog = bytearray()
        self._reason = ''
        self._stop = threading.Event()
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        os.set_blocking(self._wake_read, False)
        self._thread = threading.Thread(target=self._run, name='link', daemon=True)

    def start(self) -> None:
        """Starts the thread; it opens the port and calls the owner."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread and closes the port."""
        self._stop.set()
        self._wake()
        if self._thread.is_alive():
            self._thread.join(2.0)
        for fd in (self._wake_read, self._wake_write):
            os.close(fd)

    def reopen(self, reason: str) -> None:
        """Closes the port and tries again, because of `reason`."""
        self._reason = reason
        self._wake()

    def write(self, data: bytes) -> None:
        """Never blocks: what the port does not take now waits. Thread safe; without effect while the port is closed."""
        with self._lock:
            if self._fd < 0:
                return
            if not self._backlog:
                data = data[self._write_some(data) :]
            if not data:
                return
            self._backlog += data
            if len(self._backlog) > BACKLOG_LIMIT:
                self._backlog.clear()
                self._reason = 'the port does not take data'
        self._wake()

    def write_now(self, data: bytes) -> str:
        """For real-time bytes: they go out before all that waits, even within a line. '' or why they do not."""
        with self._lock:
            if self._fd < 0:
                return f'{self.port} is not open'
            self._backlog[:0] = data[self._write_some(data) :]
            problem = self._reason
        self._wake()
        return problem

    def _write_some(self, data: bytes | bytearray) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as e:
            self._reason = f'write failed: {e.strerror}'
            return len(data)

    def _wake(self) -> None:
        with contextlib.suppress(OSError):
            os.write(self._wake_write, b'.')

    # ---- the thread

    def _run(self) -> None:
        try:
            self._serve()
        except Exception as e:  # a defect: the owner ends the process, the controller ends the arc
            self.owner.on_crash(e)

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                self._open()
            except (OSError, ValueError) as e:
                self.owner.on_close(f'{self.port}: {reason(e)}')
                self._stop.wait(self.retry)
                continue
            self.owner.on_open()
            try:
                self._loop()
            except OSError as e:
                self._reason = self._reason or reason(e)
            finally:
                self._shut()
            if self._stop.is_set():
                return
            self.owner.on_close(f'{self.port}: {self._reason or "closed"}')
            self._stop.wait(self.retry)

    def _open(self) -> None:
        self._reason = ''
        port = serial.Serial(
            self.port, next(self._rates), timeout=0, write_timeout=0, exclusive=True
        )
        port.reset_input_buffer()
        with self._lock:
            self._serial, self._fd = port, port.fileno()
            self._backlog.clear()

    def _shut(self) -> None:
        with self._lock:
            self._fd, port, self._serial = -1, self._serial, None
        if port is not None:
            with contextlib.suppress(OSError):
                port.close()  # may wait until the port has sent what it holds: nobody waits with it

    def _loop(self) -> None:
        rest = b''
        while not self._stop.is_set() and not self._reason:
            wanted = [self._fd] if self._backlog else []
            readable, writable, _ = select.select(
                [self._fd, self._wake_read], wanted, [], self.idle
            )
            if self._wake_read in readable:
                os.read(self._wake_read, 4096)
            if writable:
                self._drain()
            if self._fd in readable:
                rest = self._read(rest)
            self.owner.on_idle()

    def _drain(self) -> None:
        with self._lock:
            del self._backlog[: self._write_some(self._backlog)]

    def _read(self, rest: bytes) -> bytes:
        """Reads what is there, hands the whole lines over, and returns the incomplete one."""
        data = os.read(self._fd, READ_BYTES)
        read_at = time.monotonic()
        if not data:
            raise OSError(errno.EIO, 'the other end hung up')
        *lines, rest = (rest + data).split(b'\n')
        if lines:
            self.owner.on_lines(lines, read_at)
        return b'' if len(rest) > LINE_LIMIT else rest


def reason(error: Exception) -> str:
    """Why a port could not be opened, in words for the user."""
    code = getattr(error, 'errno', None)
    return _PLAIN.get(code or 0) or getattr(error, 'strerror', None) or str(error)
