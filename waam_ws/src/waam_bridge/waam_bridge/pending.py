"""Commands whose outcome is reported later: with the telemetry that shows it, or once homing is accepted. Pure."""

from __future__ import annotations

from collections.abc import Callable

from . import requests

Reply = Callable[[int, str], None]
Replies = list[Callable[[], None]]  # of an outbox


class Pending:
    """Replies that are due go to the list that is handed in."""

    def __init__(self) -> None:
        self.home_line = 0  # number of the G28 that is not accepted yet, 0 = none
        self._home: tuple[Reply, float] | None = None  # reply, and its deadline
        self._after_frame: Replies = []
        self._limit = 0.0  # s

    def after_frame(self, reply: Callable[[], None], heard: float) -> None:
        """Replies after the next telemetry, or at a deadline when none comes."""
        self._after_frame.append(reply)
        self._limit = heard + requests.LIMIT

    def flush(self, due: Replies) -> None:
        """Telemetry has come: what waited for it goes to `due`."""
        if self._after_frame:
            due += self._after_frame
            self._after_frame = []

    def home(self, line: int, reply: Reply, now: float) -> None:
        """`line` is the number of the G28; the reply must be due within `requests.LIMIT` of `now` (s)."""
        self.home_line, self._home = line, (reply, now + requests.LIMIT)

    def end_home(self, code: int, text: str, due: Replies) -> None:
        """Answers the homing that waits; nothing when none does."""
        if self._home:
            reply = self._home[0]
            self.home_line, self._home = 0, None
            due.append(lambda: reply(code, text))

    def poll(self, now: float, due: Replies) -> None:
        """Replies whose deadline has passed. now: s, steady clock."""
        if self._home and now > self._home[1]:
            text = 'the controller did not accept G28 within 1 s'
            self.end_home(requests.TIMEOUT, text, due)
        if self._after_frame and now > self._limit:
            self.flush(due)
