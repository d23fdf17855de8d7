"""Pause, resume and abort as the operator asks for them; read by the job's thread."""

from __future__ import annotations

import threading


class Control:
    """Thread-safe switches. An abort also ends a pause."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._paused = False
        self._abort_reason = ''

    def pause(self) -> None:
        with self._lock:
            self._paused = True

    def resume(self) -> None:
        with self._lock:
            self._paused = False

    def abort(self, reason: str) -> None:
        with self._lock:
            self._abort_reason = self._abort_reason or reason

    @property
    def paused(self) -> bool:
        with self._lock:
            return self._paused and not self._abort_reason

    @property
    def abort_reason(self) -> str:
        with self._lock:
            return self._abort_reason
