"""Programs for robots as tests read them back: a move, and a line under a cursor. Errors name file, line, word."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from waam_plan.robot.motion import RobotProgramError, course
from waam_process.segment import Point

NUMBER = re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?')
NAME = re.compile(r'[A-Za-z_$][A-Za-z0-9_$]*')
TEXT = re.compile(r'"[^"]*"')
WORD = re.compile(r'\S+')
DEEPEST = 6  # of data in data
DOWN = (math.pi, 0.0, 0.0)  # W, P, R of an upright torch


@dataclass(frozen=True)
class Motion:
    """A line to `end`, or with `via` the arc through it.

    speed, feed: m/s; voltage: V; feed and voltage are 0 with the arc off. wpr: W, P, R of the tool at the end, rad, its
    z points out of the torch; external: B, C of the positioner at the end, rad, empty without one. zone: m before the
    end at which the next move may begin, 0 = the robot stops there.
    """

    end: Point
    via: Point | None
    speed: float
    arc: bool
    feed: float
    voltage: float = 0.0
    wpr: Point = DOWN
    external: tuple[float, ...] = ()
    zone: float = 0.0


def sample(start: Point, move: Motion, step: float = 0.2e-3) -> list[Point]:
    """Points along a move (m) without its start, for checks and pictures."""
    way = course(start, move)
    n = max(1 if move.via is None else 2, math.ceil(way.length / step))
    points = way.at(way.length * np.arange(1, n + 1) / n)
    return [tuple(p) for p in points.tolist()]


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
