"""The way of STOP past everything: one byte on a Unix socket in the folder of the running graph.

A datagram socket: nobody can hold it open, half a message does not exist, and a sender that dies leaves nothing behind.
Only the account of the graph may write to it (mode 0600). Whoever sends gets one answer, `OK` or the reason. Standard
library only: `waam stop` uses it before it loads anything else.
"""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress

NAME = 'stop'  # of the socket in the folder of the graph
STOP, HOLD = b'S', b'P'
OK = 'ok'
LONGEST = 400  # bytes of an answer
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
    """The bridge's end. OSError when the socket cannot be made. One that a killed process has left is replaced."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        made = f'{path}.{os.getpid()}'
        with _short(made) as short:
            with suppress(FileNotFoundError):
                os.unlink(made)
            self._socket.bind(short)
        os.chmod(made, 0o600)
        os.rename(made, path)
        self._mine = os.stat(path).st_ino

    def receive(self) -> tuple[bytes, object]:
        """Waits for the next message: what was sent, at most 16 bytes, and whom to answer. b'' after `close`."""
        return self._socket.recvfrom(16)

    def answer(self, text: str, whom: object) -> None:
        """Never waits; nothing when nobody waits for it."""
        if whom:
            with suppress(OSError):
                data = text.encode('utf-8', 'replace')[:LONGEST]
                self._socket.sendto(data, socket.MSG_DONTWAIT, whom)  # type: ignore[arg-type]

    def close(self) -> None:
        """Ends `receive` in another thread, and removes the file if it is still the own one."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        with suppress(OSError):
            if os.stat(self._path).st_ino == self._mine:
                os.unlink(self._path)


def post(path: str, order: bytes) -> socket.socket:
    """Sends an order and never waits. The answer comes to the socket that is returned, which is not blocking. OSError
    when no bridge listens, or takes nothing any more."""
    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        made.bind('')  # a name that the system chooses, for the answer
        with _short(path) as short:
            made.connect(short)
        made.send(order)
    except BaseException:
        made.close()
        raise
    return made


def reason(error: OSError) -> str:
    """For a person: why nothing could be sent."""
    if error.errno in (errno.ENOENT, errno.ECONNREFUSED):
        return 'no bridge is up'
    if error.errno == errno.EAGAIN:
        return 'the bridge takes nothing any more'
    return error.strerror or str(error)


def read(waiting: socket.socket) -> str | None:
    """The answer that has come, '' = done; None while there is none."""
    try:
        text = waiting.recv(LONGEST).decode('utf-8', 'replace')
    except BlockingIOError:
        return None
    except OSError as e:
        return reason(e)
    return '' if text == OK else text


def send(path: str, order: bytes, patience: float = PATIENCE_S) -> str:
    """Sends an order and waits at most `patience` s for the answer: '' = the controller has been told, else why not."""
    try:
        with post(path, order) as waiting:
            waiting.settimeout(patience)
            answer = read(waiting)
    except OSError as e:
        return reason(e)
    return f'the bridge did not answer within {patience:g} s' if answer is None else answer
