"""The way of STOP past everything: one byte on a Unix socket in the folder of the running graph.

A datagram socket: nobody can hold it open, half a message does not exist, and a sender that dies leaves nothing behind.
Only the account of the graph may write to it (mode 0600). With the order goes one end of a socket of the sender's own:
the answer, `OK` or the reason, comes there, so that answers that nobody reads take nobody else's room. Standard library
only: `waam stop` uses it before it loads anything else.

Beside it lies a pipe for a shell, which can write a byte without starting a program: `printf S 1<>RUN/stop_now`. It
answers nothing.
"""

from __future__ import annotations

import errno
import os
import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

NAME = 'stop'  # of the socket in the folder of the graph
PIPE = '_now'  # behind the name of the socket: that of the pipe
STOP, HOLD = b'S', b'P'
OK = 'ok'
MAX_ANSWER_BYTES = 400  # bytes of an answer
PATIENCE_S = 1.0


@contextmanager
def _short(path: str) -> Iterator[str]:
    """The same file under a name that fits into the 107 bytes of a socket's address."""
    folder = os.open(os.path.dirname(path) or '.', os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f'/proc/self/fd/{folder}/{os.path.basename(path)}'
    finally:
        os.close(folder)


class Listener:
    """The bridge's end. OSError when socket or pipe cannot be made. What a killed process has left is replaced."""

    def __init__(self, path: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        made = f'{path}.{os.getpid()}'
        with _short(made) as short:
            with suppress(FileNotFoundError):
                os.unlink(made)
            self._socket.bind(short)
        os.mkfifo(made + PIPE, 0o600)
        self._pipe = os.open(made + PIPE, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        os.chmod(made, 0o600)
        self._mine = {}
        for end in (PIPE, ''):
            os.rename(made + end, path + end)
            self._mine[path + end] = os.stat(path + end).st_ino
        self._poll = select.poll()
        for source in (self._socket.fileno(), self._pipe):
            self._poll.register(source, select.POLLIN)

    def receive(self) -> list[tuple[bytes, Any]]:
        """Waits for the next messages: what was sent, at most 16 bytes, and whom to answer. [] after `close`."""
        found: list[tuple[bytes, Any]] = []
        for source, _ in self._poll.poll():
            if source == self._pipe:
                found += [(bytes([b]), None) for b in dict.fromkeys(os.read(source, 4096))]
            else:
                data, ends, _, _ = socket.recv_fds(self._socket, 16, 1)
                whom = socket.socket(fileno=ends[0]) if ends else None
                found += [(data, whom)] if data or whom else []
        return found

    def answer(self, text: str, whom: Any) -> None:
        """Never waits; nothing when nobody waits for it. Once per message: it closes the end that came with it."""
        if whom:
            with suppress(OSError), whom:
                data = text.encode('utf-8', 'replace')[:MAX_ANSWER_BYTES]
                whom.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)

    def close(self) -> None:
        """Ends `receive` in another thread, and removes the file if it is still the own one."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        for path, mine in self._mine.items():
            with suppress(OSError):
                if os.stat(path).st_ino == mine:
                    os.unlink(path)


def post(path: str, order: bytes) -> socket.socket:
    """Sends an order and never waits. The answer comes to the socket that is returned, which is not blocking. OSError
    when no bridge listens. Where the socket is full the order goes into the pipe, without an answer."""
    try:
        return _sent(path, order, 0.0)
    except BlockingIOError:
        pipe = os.open(path + PIPE, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            os.write(pipe, order)
        finally:
            os.close(pipe)
        waiting, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        end.close()
        waiting.setblocking(False)
        return waiting


def _sent(path: str, order: bytes, patience: float) -> socket.socket:
    """The socket where the answer comes, with this patience (s); the order is on its way."""
    waiting, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        waiting.settimeout(patience)
        with end, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as way, _short(path) as short:
            way.settimeout(patience)
            way.connect(short)
            socket.send_fds(way, [order], [end.fileno()])
    except BaseException:
        waiting.close()
        raise
    return waiting


def reason(error: OSError) -> str:
    """For a person: why nothing could be sent."""
    if error.errno in (errno.ENOENT, errno.ECONNREFUSED):
        return 'no bridge is up'
    if isinstance(error, BlockingIOError | TimeoutError):
        return 'the bridge takes nothing any more'
    return error.strerror or str(error)


def read(waiting: socket.socket) -> str | None:
    """The answer that has come, '' = done; None while there is none, or when none can come any more."""
    try:
        text = waiting.recv(MAX_ANSWER_BYTES).decode('utf-8', 'replace')
        if not text:
            return None
    except (BlockingIOError, TimeoutError):
        return None
    except OSError as e:
        return reason(e)
    return '' if text == OK else text


def send(path: str, order: bytes, patience: float = PATIENCE_S) -> str:
    """Sends an order and waits at most `patience` s for the answer: '' = the controller has been told, else why not."""
    try:
        with _sent(path, order, patience) as waiting:
            answer = read(waiting)
    except OSError as e:
        return reason(e)
    return f'the bridge did not answer within {patience:g} s' if answer is None else answer
