"""What the controller makes of moves from rest to rest: whole steps, tick by tick (waam_motion.c). Pure. mm, s.

The spectrum of the commanded motion is only as good as the motion that is taken for it. Close to one step per move the
rounding to ticks and steps is a large part of it, so it is computed as the controller does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

TICK = 1e-3  # s
SAME_PLACE = 1e-9  # mm


@dataclass
class _Mover:
    """The move under way: `left` of it, the speed now."""

    acceleration: float
    left: float = 0.0
    speed: float = 0.0

    def advance(self, limit: float, dt: float) -> tuple[float, bool]:
        """At most `dt` along the move: the time used, and whether its end is reached."""
        v0, left, a = self.speed, self.left, self.acceleration
        if v0 > 0 and 2 * left <= v0 * dt and v0 * v0 <= 2.02 * a * left + 1e-6:
            return self._end(2 * left / v0)
        half = 0.5 * a * dt
        root = half * half - a * dt * v0 + 2 * a * left
        braking = math.sqrt(root) - half if root > 0 else 0.0
        v1 = max(0.0, min(max(min(limit, braking), v0 - a * dt), v0 + a * dt))
        way = 0.5 * (v0 + v1) * dt
        if way < left - SAME_PLACE:
            self.left, self.speed = left - way, v1
            return dt, False
        at_end = math.sqrt(max(0.0, v0 * v0 + 2 * (v1 - v0) / dt * left))
        mean = 0.5 * (v0 + at_end)
        return self._end(min(dt, left / mean) if mean > 0 else dt)

    def _end(self, time: float) -> tuple[float, bool]:
        self.left = self.speed = 0.0
        return time, True


def positions(
    stops: Sequence[float], speeds: Sequence[float], acceleration: float, steps_per_mm: float
) -> np.ndarray:
    """Steps (n,) at the end of every tick of moves from 0 to each stop (mm) in turn, at most at `speeds` (mm/s)."""
    found, at, k = [], 0.0, 0
    mover = _Mover(acceleration, abs(stops[0]))
    while k < len(stops):
        dt = TICK
        while dt > SAME_PLACE and k < len(stops):
            used, done = mover.advance(speeds[k], dt)
            dt -= used
            if done:
                at, k = stops[k], k + 1
                mover.left = abs(stops[k] - at) if k < len(stops) else 0.0
        here = at
        if k < len(stops):
            here = stops[k] - math.copysign(mover.left, stops[k] - at)
        found.append(math.floor(here * steps_per_mm + 0.5))
    return np.array(found)
