"""The motion that makes an axis swing: there and back, ever faster. Pure. SI.

Every half period is one move from rest to rest, in whole steps of the motor, within the acceleration of the axis; its
speed is chosen so that it takes the half period. The shortest such move is one step, so the lines end at the frequency
where one step just fits: 100 Hz at 0.5 m/s^2 and 320 steps per mm. What lies above is shaken by the third harmonic of
the moves, which alone have a third of the acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from waam_process.segment import Kind, Point, Segment

from .execution import TICK, positions

AXES = ('x', 'y')


@dataclass(frozen=True)
class Sweep:
    """From `low` to `high` Hz, `rate` Hz per second. stroke: longest move, m; step: of the motor, m; acceleration: of
    the axis, m/s^2."""

    low: float = 1.0
    high: float = 134.0
    rate: float = 2.0
    stroke: float = 2e-3
    step: float = 1e-3 / 320
    acceleration: float = 0.5

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
        return min(self.high, math.sqrt(self.acceleration / (16 * self.step)))

    @cached_property
    def moves(self) -> list[tuple[int, float, float]]:
        """Steps, speed (m/s) and duration (s) of every half period; there and back are as long."""
        found, hz = [], self.low
        while hz < self.top:
            half = 0.5 / hz
            longest = min(self.stroke, 0.25 * self.acceleration * half * half)
            steps = max(1, int(longest / self.step + 1e-6))
            found += 2 * [(steps, *self._timed(steps, half))]
            hz += self.rate * 2 * half
        return found

    def _timed(self, steps: int, half: float) -> tuple[float, float]:
        """Speed so that the move takes `half`, and what it takes."""
        a, way = self.acceleration, steps * self.step
        room = max(0.0, (a * half) ** 2 - 4 * a * way)
        speed = 0.5 * (a * half - math.sqrt(room))
        return speed, way / speed + speed / a

    @property
    def duration(self) -> float:
        """s"""
        return sum(d for _, _, d in self.moves)

    def segments(self, axis: str, start: Point, first: int) -> list[Segment]:
        """The moves about `start` (m, work frame) along +axis and back, numbered from `first`."""
        index = AXES.index(axis)
        near, found = start, []
        for k, (steps, speed, _) in enumerate(self.moves):
            off = steps * self.step if k % 2 == 0 else 0.0
            p = list(start)
            p[index] += off
            to = (p[0], p[1], p[2])
            found.append(Segment(first + k, Kind.IDLE, near, to, speed))
            near = to
        return found

    def commanded(self) -> np.ndarray:
        """Acceleration (n,) m/s^2 of the axis in every tick, in whole steps as the controller executes them."""
        stops = [
            round(1e3 * s * self.step, 4) if k % 2 == 0 else 0.0
            for k, (s, _, _) in enumerate(self.moves)
        ]
        speeds = [1e3 * v for _, v, _ in self.moves]
        steps = positions(stops, speeds, 1e3 * self.acceleration, 1e-3 / self.step)
        return np.diff(steps * self.step, n=2, prepend=[0.0, 0.0]) / TICK**2
