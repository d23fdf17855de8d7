"""A sign of life for the program that started this process, by the protocol of systemd (sd_notify, `WATCHDOG=1`).

The supervisor of `waam up` listens to it; so does systemd for a unit with `WatchdogSec`. No ROS: a process whose
middleware hangs must be noticed as well.
"""

from __future__ import annotations

import os
import socket
from contextlib import suppress

ADDRESS = 'NOTIFY_SOCKET'  # environment: path of a datagram socket, '@name' = abstract
RESTARTED = 'WAAM_RESTARTED'  # environment: why the supervisor has started this process again


class SignOfLife:
    """Call `give` at any time; it never waits and never fails."""

    def __init__(self, address: str | None = None) -> None:
        address = os.environ.get(ADDRESS, '') if address is None else address
        self._address = '\0' + address[1:] if address.startswith('@') else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def give(self) -> None:
        """Sends `WATCHDOG=1`; nothing when the process was started without NOTIFY_SOCKET."""
        if self._address:
            with suppress(OSError):  # nobody listens, or the queue is full
                self._socket.sendto(b'WATCHDOG=1', self._address)

    def close(self) -> None:
        """Closes the socket; `give` must not be called any more."""
        self._socket.close()
