"""Idle moves with continuous acceleration: the harmonic law of source 004.

Equations (1)-(3) of S4, see docs/equations.md.

The law joins two places with R'' = A cos(k t + psi), R' = (A / k)(sin(k t + psi) - sin psi) + C. The torch stands still
where the arc goes off and where it is lit, so speed and acceleration vanish at both ends; then psi = -pi/2,
k = 2 pi / T, C = 0 and A = 2 pi L / T^2, and no iteration is needed: R = L (u - sin(2 pi u) / (2 pi)), u = t / T.
Given place, speed and acceleration at the begin and place and acceleration at the end, `JoiningLaw` finds k by
iteration; the speed at the end is what comes out.

The controller is told pieces of one speed each and goes from one to the next with the acceleration of its axes, so its
motion has the law's acceleration on average over a piece only. More pieces follow the law more closely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

FINEST = 0.2e-3  # m: pieces of a move are no shorter than this on average
END = 2e-6  # m: the least length of a piece at either end
PIECES = 72  # of equal time, at most: with 50 the steps of the speed still show in the jerk
# rad of the whole move: below it rounding is larger than what the angle changes
SMALLEST = 0.01


@dataclass(frozen=True)
class HarmonicLaw:
    """From rest to rest over `length` (m) in `duration` (s)."""

    length: float
    duration: float

    @classmethod
    def within(cls, length: float, speed: float, acceleration: float) -> HarmonicLaw:
        """The quickest one within a highest speed (m/s) and acceleration (m/s2)."""
        by_speed = 2 * length / speed
        by_acceleration = math.sqrt(2 * math.pi * length / acceleration)
        return cls(length, max(by_speed, by_acceleration))

    def position(self, t: float | np.ndarray) -> np.ndarray:
        """m after t seconds."""
        u = np.asarray(t, float) / self.duration
        return self.length * (u - np.sin(2 * np.pi * u) / (2 * np.pi))

    def speed(self, t: float | np.ndarray) -> np.ndarray:
        """m/s after t seconds; zero at both ends."""
        u = np.asarray(t, float) / self.duration
        return self.length / self.duration * (1 - np.cos(2 * np.pi * u))

    def acceleration(self, t: float | np.ndarray) -> np.ndarray:
        """m/s2 after t seconds; zero at both ends, so it does not break where moves meet."""
        u = np.asarray(t, float) / self.duration
        return 2 * np.pi * self.length / self.duration**2 * np.sin(2 * np.pi * u)

    def pieces(self, most: int = PIECES) -> tuple[np.ndarray, np.ndarray]:
        """Places (n + 1,) m and mean speeds (n,) m/s of pieces of equal time, n at most `most`. Those at the ends are
        joined until they are as long as END, for the coordinates of a program are rounded to micrometres."""
        n = int(
            np.clip(round(self.length / FINEST, 3), 1, most)
        )  # equal legs have equal pieces in every layer
        t = np.linspace(0, self.duration, n + 1)
        return _pieces(t, self.position(t))


def _pieces(t: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and mean speeds between the times t (n + 1,) s at which the places `at` (n + 1,) m are passed."""
    kept = (at >= at[0] + END) & (at <= at[-1] - END)
    kept[[0, -1]] = True
    return at[kept], np.diff(at[kept]) / np.diff(t[kept])


class JoinError(ValueError):
    """No law of this form joins both ends; the text says within which k was looked."""


@dataclass(frozen=True)
class JoiningLaw:
    """R'' = a cos(k t) - b sin(k t) from t = 0 to `duration`, with a = A cos psi and b = A sin psi of the source: this
    form has no singular psi. Any unit of length; s."""

    a: float
    b: float
    k: float
    start: float
    speed_start: float
    duration: float

    @classmethod
    def joining(
        cls,
        start: tuple[float, float, float],
        end: tuple[float, float],
        duration: float,
        turns: float = 1.0,
    ) -> JoiningLaw:
        """start: place, speed, acceleration; end: place, acceleration. k is the smallest that fits, of at most `turns`
        full turns within the duration. JoinError when none does. Without acceleration at either end half a turn
        fits, and the amplitude follows from the way."""
        if start[2] == end[1] == 0.0:
            k = math.pi / duration
            b = k * (start[1] - (end[0] - start[0]) / duration)
            return cls(0.0, b, k, start[0], start[1], duration)
        most = 2 * math.pi * turns / duration

        def law(k: float) -> JoiningLaw:
            angle = k * duration
            b = (start[2] * math.cos(angle) - end[1]) / math.sin(angle)
            return cls(start[2], b, k, start[0], start[1], duration)

        def missed(k: float) -> float:
            return float(law(k).position(duration)) - end[0]

        for low, high in _between_poles(duration, most):
            grid = np.linspace(low, high, 200)
            value = [missed(k) for k in grid]
            for i in range(len(grid) - 1):
                if value[i] == 0.0 or value[i] * value[i + 1] < 0:
                    return law(float(brentq(missed, grid[i], grid[i + 1], xtol=1e-14)))
        raise JoinError(
            f'no k up to {most:g} 1/s ends at {end[0]:g} with the acceleration {end[1]:g}'
        )

    def pieces(self, most: int = PIECES) -> tuple[np.ndarray, np.ndarray]:
        """As those of `HarmonicLaw`, between places in m. JoinError for a law that stops or turns back on its way."""
        t = np.linspace(0, self.duration, 2 * most + 1)
        at = self.position(t)
        if not (self.speed(t[1:-1]) > 0).all():
            raise JoinError('the law stops or turns back before its end')
        n = int(np.clip(round((at[-1] - at[0]) / FINEST, 3), 1, most))
        t = np.linspace(0, self.duration, n + 1)
        return _pieces(t, self.position(t))

    @property
    def amplitude(self) -> float:
        """A of the source, with its sign: that of the acceleration at the begin."""
        return math.copysign(math.hypot(self.a, self.b), self.a)

    @property
    def psi(self) -> float:
        """rad, of the source."""
        return math.atan2(self.b, self.a) if self.a >= 0 else math.atan2(-self.b, -self.a)

    def position(self, t: float | np.ndarray) -> np.ndarray:
        """Place after t seconds."""
        t, k = np.asarray(t, float), self.k
        swing = self.a * (1 - np.cos(k * t)) + self.b * np.sin(k * t)
        return self.start + (self.speed_start - self.b / k) * t + swing / k**2

    def speed(self, t: float | np.ndarray) -> np.ndarray:
        """After t seconds."""
        t, k = np.asarray(t, float), self.k
        return self.speed_start + (self.a * np.sin(k * t) + self.b * (np.cos(k * t) - 1)) / k

    def acceleration(self, t: float | np.ndarray) -> np.ndarray:
        """After t seconds."""
        t, k = np.asarray(t, float), self.k
        return self.a * np.cos(k * t) - self.b * np.sin(k * t)


def _between_poles(duration: float, most: float) -> list[tuple[float, float]]:
    """Ranges of k up to `most` between the values where sin(k duration) = 0: no b belongs to those."""
    pole = math.pi / duration
    ends = [SMALLEST / duration, *np.arange(pole, most, pole), most]
    edge = 1e-6 * pole
    return [(a + edge, b - edge) for a, b in zip(ends, ends[1:], strict=False) if b - a > 3 * edge]
