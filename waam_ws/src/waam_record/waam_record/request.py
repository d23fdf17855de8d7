"""A call of record/control on its way to the thread of the recording, and what comes back. No ROS."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


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


class Request:
    """A call of record/control, for the thread of the recording. code: of Record.srv; asked: s, steady clock.

    `reply` is called once, whoever has an answer first. A START that was `cancelled` must not record."""

    def __init__(
        self,
        code: int,
        directory: str,
        custom_data: dict[str, str],
        reply: Callable[[Answer], None],
        asked: float,
    ) -> None:
        self.code, self.directory, self.custom_data = code, directory, custom_data
        self.cancelled = False
        self.asked = asked
        self._reply, self._answered = reply, False
        self._lock = threading.Lock()

    def answer(self, answer: Answer) -> bool:
        """Replies; False when that was done already. Thread-safe."""
        with self._lock:
            first, self._answered = not self._answered, True
        if first:
            self._reply(answer)
        return first

    def concerns(self, directory: Path | str) -> bool:
        """Whether it means the recording in this folder; one without a folder means any."""
        return not self.directory or os.path.abspath(self.directory) == os.path.abspath(directory)
