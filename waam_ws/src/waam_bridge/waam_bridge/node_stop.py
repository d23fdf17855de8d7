"""STOP and HOLD past everything else: a thread that only waits for one byte, and puts it on the wire.

It needs no callback, no lock of the core, no file and no log before the controller has been told. What else belongs to
a STOP (the job ends, the queue is dropped, a line in the log) follows in a second thread, so that the next STOP never
waits for it.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import suppress

from waam_node.stop_socket import HOLD, OK, STOP, Listener

from . import frames

BYTES = {STOP: frames.STOP_NOW, HOLD: frames.HOLD_NOW}
URGENT = -10  # nice value of the thread, where the account may have it


class StopLane:
    """act(bytes for the controller) -> '' or why they were not sent; must not wait. after(order): the rest."""

    def __init__(
        self, path: str, act: Callable[[bytes], str], after: Callable[[bytes], None]
    ) -> None:
        self._listener = Listener(path)
        self._act, self._after = act, after
        self._due: dict[bytes, None] = {}
        self._wake = threading.Condition()
        self._over = False
        for name, run in (('stop', self._run), ('after_stop', self._follow)):
            threading.Thread(target=run, name=name, daemon=True).start()

    def close(self) -> None:
        """Ends both threads."""
        self._over = True
        self._listener.close()
        with self._wake:
            self._wake.notify()

    def _run(self) -> None:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), URGENT)
        while not self._over:
            try:
                messages = self._listener.receive()
            except OSError:
                return
            for order, whom in messages:
                self._take(order, whom)

    def _take(self, order: bytes, whom: object) -> None:
        data = BYTES.get(order)
        if data is None:
            self._listener.answer(f'{order!r} is no order', whom)
            return
        self._listener.answer(self._act(data) or OK, whom)
        with self._wake:
            self._due[order] = None
            self._wake.notify()

    def _follow(self) -> None:
        while True:
            with self._wake:
                while not self._due and not self._over:
                    self._wake.wait()
                if self._over:
                    return
                due, self._due = self._due, {}
            for order in due:
                self._after(order)
