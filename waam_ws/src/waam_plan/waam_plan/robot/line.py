"""A line of a program under a cursor. Errors name file, line and word."""

from __future__ import annotations

import math
import re
from typing import NoReturn

from waam_plan.robot.motion import RobotProgramError

NUMBER = re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?')
NAME = re.compile(r'[A-Za-z_$][A-Za-z0-9_$]*')
TEXT = re.compile(r'"[^"]*"')
WORD = re.compile(r'\S+')
DEEPEST = 6  # of data in data


class Line:
    """Takes pieces of a line from left to right; blanks between them do not count."""

    def __init__(self, file: str, number: int, text: str) -> None:
        self.file, self.number, self.text = file, number, text
        self._at = self._last = 0

    def again(self) -> Line:
        """The line with the cursor at its begin."""
        return Line(self.file, self.number, self.text)

    def _skip(self) -> int:
        while self._at < len(self.text) and self.text[self._at].isspace():
            self._at += 1
        return self._at

    @property
    def at(self) -> int:
        """Where the next piece begins."""
        return self._skip()

    @property
    def done(self) -> bool:
        """Whether nothing is left."""
        return self._skip() >= len(self.text)

    def maybe(self, pattern: str | re.Pattern[str]) -> re.Match[str] | None:
        """What stands here, if it fits."""
        match = re.compile(pattern).match(self.text, self._skip())
        if match:
            self._last, self._at = match.start(), match.end()
        return match

    def take(self, pattern: str | re.Pattern[str], wanted: str) -> re.Match[str]:
        """What stands here. RobotProgramError where it does not fit."""
        match = self.maybe(pattern)
        return match if match else self.fail(wanted)

    def number_here(self, wanted: str = 'a number') -> float:
        """A finite number."""
        value = float(self.take(NUMBER, wanted)[0])
        return value if math.isfinite(value) else self.refuse(f'{wanted} that is finite')

    def count(self, wanted: str = 'a whole number') -> int:
        """A whole number of at most nine digits."""
        return int(self.take(r'\d{1,9}(?![\d.])', wanted)[0])

    def end(self) -> None:
        """RobotProgramError where something is left."""
        if not self.done:
            self.fail('the end of the line')

    def refuse(self, wanted: str) -> NoReturn:
        """RobotProgramError that names what was taken last."""
        self._at = self._last
        self.fail(wanted)

    def fail(self, wanted: str) -> NoReturn:
        """RobotProgramError that names the word under the cursor."""
        begin = self._skip()
        word = WORD.match(self.text, begin)
        shown = f"'{word[0][:40]}'" if word else 'end of the line'
        count = len(WORD.findall(self.text[:begin])) + 1
        if begin and not self.text[begin - 1].isspace():
            count -= 1  # the cursor is inside a word
        raise RobotProgramError(
            f'{self.file}, line {self.number}, word {count} ({shown}): wanted {wanted}'
        )
