"""Immediate lines that wait for their answer: order, repetition, time limit. Pure: time is an argument (s)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from . import frames

# error codes of waam_msgs/srv/Command
OK, NOT_CONNECTED, WRONG_STATE, BAD_ARGUMENT, REFUSED, TIMEOUT = 0, 300, 304, 306, 307, 308

Done = Callable[[int, str], None]  # called once with code and text

REPEAT_AFTER = 0.25  # s without an answer; only lines that may be repeated
LIMIT = 1.0  # s


@dataclass
class _Request:
    letter: str
    line: bytes
    done: Done
    asked: float
    again: float


class Requests:
    """Answers carry only the letter of the line, so per letter they belong to the oldest request."""

    def __init__(self) -> None:
        self._waiting: list[_Request] = []

    def ask(self, letter: str, args: str, done: Done, now: float, repeat: bool = True) -> bytes:
        """The line to write. `repeat`: it may be sent twice without harm. Raises FrameError, see `frames.immediate`."""
        line = frames.immediate(letter, args)
        again = now + REPEAT_AFTER if repeat else float('inf')
        self._waiting.append(_Request(letter, line, done, now, again))
        return line

    def waits(self, letter: str) -> bool:
        return any(r.letter == letter for r in self._waiting)

    def answer(self, answer: frames.Answer) -> bool:
        """Ends the oldest request with this letter; False when none waits (the second answer to a repeated line)."""
        for r in self._waiting:
            if r.letter == answer.letter:
                self._waiting.remove(r)
                if answer.code:
                    text = answer.text or frames.CODES.get(answer.code, '')
                    r.done(REFUSED, f'controller: E{answer.code} {text}'.rstrip())
                else:
                    r.done(OK, '' if answer.text == 'ok' else answer.text)
                return True
        return False

    def poll(self, now: float) -> bytes:
        """Lines to write again; requests that are too old end with TIMEOUT."""
        out = b''
        for r in list(self._waiting):
            if now - r.asked > LIMIT:
                self._waiting.remove(r)
                r.done(TIMEOUT, f'the controller did not answer ${r.letter} within {LIMIT:g} s')
            elif now > r.again:
                r.again = now + REPEAT_AFTER
                out += r.line
        return out

    def fail(self, text: str) -> None:
        """Ends all requests: the link is gone."""
        waiting, self._waiting = self._waiting, []
        for r in waiting:
            r.done(NOT_CONNECTED, text)
