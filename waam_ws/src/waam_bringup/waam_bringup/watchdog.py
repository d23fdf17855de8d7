"""Listens to the signs of life of processes (`waam_node.alive`) and says which of them have fallen silent."""

from __future__ import annotations

import os
import socket
import struct
import time
from itertools import count

_CREDENTIALS = struct.Struct('3i')  # pid, uid, gid of the sender, filled in by the kernel
_number = count()
# s between two looks above which nothing is judged: the machine slept or was too busy
SLEPT_S = 5.0


class Watchdog:
    """timeout: s of silence after which a process counts as hanging; 0 = never."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        name = f'waam-supervisor-{os.getpid()}-{next(_number)}'
        self.address = f'@{name}'
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.setblocking(False)
        self._socket.bind(f'\0{name}')
        self._heard: dict[int, float | None] = {}  # pid -> when; None = not yet, it still starts
        self._looked = time.monotonic()

    def watch(self, pid: int) -> None:
        """Expects signs of life of this process; it counts as hanging only after its first one."""
        self._heard[pid] = None

    def forget(self, pid: int) -> None:
        """The process has ended or is to be ended."""
        self._heard.pop(pid, None)

    def forgive(self, now: float) -> None:
        """Nobody has been silent up to now (steady time)."""
        self._heard = {p: None if t is None else now for p, t in self._heard.items()}

    def last_heard(self, pid: int) -> float | None:
        """Steady time of the newest sign of life; None = none yet."""
        return self._heard.get(pid)

    def silent(self, now: float, timeout: float | None = None) -> dict[int, float]:
        """Processes that were heard once and then not for `timeout` s (None: the watchdog's): pid -> s of silence."""
        timeout = self.timeout if timeout is None else timeout
        self._listen(now)
        if now - self._looked > SLEPT_S:
            self.forgive(now)
        self._looked = now
        if timeout <= 0:
            return {}
        quiet = {p: now - t for p, t in self._heard.items() if t is not None}
        return {p: s for p, s in quiet.items() if s > timeout}

    def _listen(self, now: float) -> None:
        while True:
            try:
                text, ancillary, _, _ = self._socket.recvmsg(
                    256, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
            except OSError:
                return
            for level, kind, data in ancillary:
                if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS):
                    pid = _CREDENTIALS.unpack(data[: _CREDENTIALS.size])[0]
                    if pid in self._heard and b'WATCHDOG=1' in text.split(b'\n'):
                        self._heard[pid] = now

    def close(self) -> None:
        """Closes the socket."""
        self._socket.close()
