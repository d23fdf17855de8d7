"""The motion that makes an axis swing: there and back, ever faster. Pure. SI.

Every half period is one move from rest to rest within the acceleration of the axis; its speed is chosen so that it
takes the half period. A move is as many whole steps of the motor as fit. Where not even one fits (above 100 Hz at 0.5
m/s^2 and 320 steps per mm) it is the middle of a step: the motor makes its step on the way all the same, and the way is
shorter. Less than MIN_STEP_SHARE of a step would be lost where the axis does not begin on one; so the lines end at 134
Hz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from waam_process.segment import Kind, Point, Segment

from .execution import TICK, positions

AXES = ('x', 'y')
MIN_STEP_SHARE = 0.55  # of a step that a move is at least
STEPS_PER_MM = 320.0  # of the controller as shipped
ACCELERATION = 500.0  # mm/s^2, the same


@dataclass(frozen=True)
class Sweep:
    """From `low` to `high` Hz, `rate` Hz per second. stroke: longest move, m; step: of the motor, m; acceleration: of
    the axis, m/s^2."""

    low: float = 1.0
    high: float = 134.0
    rate: float = 2.0
    stroke: float = 2e-3
    step: float = 1e-3 / STEPS_PER_MM
    acceleration: float = 1e-3 * ACCELERATION

    def __post_init__(self) -> None:
        if not 0.5 <= self.low < self.high <= 300.0:
            raise ValueError(
                f'sweep from {self.low:g} to {self.high:g} Hz: must rise within 0.5 .. 300 Hz'
            )
        if not 0.1 <= self.rate <= 20.0:
            raise ValueError(f'sweep of {self.rate:g} Hz/s: must be 0.1 .. 20 Hz/s')
        for name in ('stroke', 'step', 'acceleration'):
            if not (math.isfinite(value := getattr(self, name)) and value > 0):
                raise ValueError(f'{name} of the sweep is {value:g}, must be above 0')

    @property
    def top(self) -> float:
        """Frequency (Hz) of the last move."""
        return min(self.high, math.sqrt(self.acceleration / (16 * MIN_STEP_SHARE * self.step)))

    @cached_property
    def moves(self) -> list[tuple[float, float, float]]:
        """End (m), speed (m/s) and duration (s) of every half period; the first begins at 0."""
        found, at, hz = [], 0.0, self.low
        while hz < self.top:
            half = 0.5 / hz
            for end in reversed(self._ends(0.25 * self.acceleration * half * half)):
                found.append((end, *self._timed(abs(end - at), half)))
                at = end
            hz += self.rate * 2 * half
        return found

    def _ends(self, longest: float) -> tuple[float, float]:
        """Near and far end (m) of moves of at most this length."""
        steps = int(min(self.stroke, longest) / self.step + 1e-6)
        if steps:
            return 0.0, steps * self.step
        return 0.5 * (self.step - longest), 0.5 * (self.step + longest)

    def _timed(self, way: float, half: float) -> tuple[float, float]:
        """Speed so that a move takes `half`, and what it takes."""
        a = self.acceleration
        room = max(0.0, (a * half) ** 2 - 4 * a * way)
        speed = 0.5 * (a * half - math.sqrt(room))
        return speed, way / speed + speed / a

    @property
    def duration(self) -> float:
        """s"""
        return sum(d for _, _, d in self.moves)

    def on_step(self, point: Point, axis: str, zero: Point) -> Point:
        """The point (m, work frame) with this axis on a whole step of the motor, which are counted from the zero of the
        machine. zero: of the work frame in machine coordinates, m."""
        p, k = list(point), AXES.index(axis)
        p[k] = round((p[k] + zero[k]) / self.step) * self.step - zero[k]
        return p[0], p[1], p[2]

    def segments(self, axis: str, start: Point, first: int) -> list[Segment]:
        """The moves about `start` (m, work frame; on a whole step) along +axis and back, numbered from `first`."""
        index = AXES.index(axis)
        near, found = start, []
        for k, (end, speed, _) in enumerate(self.moves):
            p = list(start)
            p[index] += end
            to = (p[0], p[1], p[2])
            found.append(Segment(first + k, Kind.IDLE, near, to, speed))
            near = to
        return found

    def commanded(self) -> np.ndarray:
        """Acceleration (n,) m/s^2 of the axis in every tick, in whole steps as the controller executes them."""
        stops = [round(1e3 * end, 4) for end, _, _ in self.moves]
        speeds = [1e3 * v for _, v, _ in self.moves]
        steps = positions(stops, speeds, 1e3 * self.acceleration, 1e-3 / self.step)
        return np.diff(steps * self.step, n=2, prepend=[0.0, 0.0]) / TICK**2
