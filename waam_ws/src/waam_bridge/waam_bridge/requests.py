"""Immediate lines that wait for their answer: tokens, repetition, time limit. Pure: time is an argument (s)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from . import frames

# error codes of waam_msgs/srv/Command
OK, NOT_CONNECTED, WRONG_STATE, BAD_ARGUMENT, REFUSED, TIMEOUT = (0, 300, 304, 306, 307, 308)

Done = Callable[[int, str], None]  # called once with code and text

REPEAT_AFTER = 0.1  # s without an answer; the controller does a repeated line once
REPEAT_URGENT = 0.03  # s, for what has to act at once
URGENT = 'PSV'
LIMIT = 1.0  # s
TOKENS = 2**32


@dataclass
class _Request:
    letter: str
    token: int
    line: bytes
    done: Done
    asked: float
    again: float


class Requests:
    """Every line carries a token that its answer repeats, so a late answer is never taken for another one's."""

    def __init__(self) -> None:
        self.digits = frames.CRC16
        self._waiting: list[_Request] = []
        self._token = 0

    def ask(self, letter: str, args: str, done: Done, now: float) -> bytes:
        """The line to write. Raises FrameError, see `frames.immediate`."""
        self._token = self._token % (TOKENS - 1) + 1
        line = frames.immediate(letter, args, self._token, self.digits)
        self._waiting.append(_Request(letter, self._token, line, done, now, now + _pause(letter)))
        return line

    def waits(self, letter: str) -> bool:
        """Whether a line with this letter has no answer yet."""
        return any(r.letter == letter for r in self._waiting)

    def supersede(self, letter: str, text: str) -> None:
        """Stops repeating requests with this letter, because a newer one replaces them."""
        for r in [r for r in self._waiting if r.letter == letter]:
            self._waiting.remove(r)
            r.done(OK, text)

    def answer(self, answer: frames.Answer) -> bool:
        """Ends the request with this token; False when none waits (the second answer to a repeated line)."""
        for r in self._waiting:
            if r.token == answer.token and answer.letter in (r.letter, '?'):
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
                r.again = now + _pause(r.letter)
                out += r.line
        return out

    def fail(self, text: str) -> None:
        """Ends all requests: the link is gone."""
        waiting, self._waiting = self._waiting, []
        for r in waiting:
            r.done(NOT_CONNECTED, text)


def _pause(letter: str) -> float:
    return REPEAT_URGENT if letter in URGENT else REPEAT_AFTER
