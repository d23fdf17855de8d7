"""How a layer cools between passes, learned from the layers before it: the wait for an interpass limit.

A layer under the pyrometer does not cool like one lump (exponentially): at first heat runs into the colder wall below,
later the wall as a whole cools, and both change slowly as the part grows. But neighbouring layers cool alike. So the
curve of the last dwell is the model; what the present dwell has shown so far scales its excess temperature, and what
the same prediction would have missed on the last dwell corrects the rest. Times s, temperatures degC; pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waam_process.heat import cooling_wait

SPACING = 0.5  # s between stored samples
RISE = 8.0  # K above the lowest reading that mean the next pass is on its way
MIN_DROP, MIN_SAMPLES = 20.0, 10  # of a dwell that teaches something
# of excess temperature between neighbouring layers; beyond, the last curve is no model
SCALE = (0.5, 1.6)
TRUST = (0.8, 1.25)  # bounds of the correction by the last dwell's own miss


@dataclass(frozen=True)
class Curve:
    """One dwell from its peak on: seconds since the peak and degC, both (n,), times rising."""

    time: np.ndarray
    temperature: np.ndarray

    @property
    def usable(self) -> bool:
        """Long enough and with enough of a drop to predict the next dwell from."""
        drop = self.temperature[0] - self.temperature[-1] if len(self.time) else 0.0
        return len(self.time) >= MIN_SAMPLES and drop >= MIN_DROP

    def at(self, time: float | np.ndarray) -> np.ndarray:
        """degC, `time` s after the peak; linear between samples, constant beyond both ends."""
        return np.interp(time, self.time, self.temperature)

    def until(self, time: float) -> Curve:
        """The part before `time`."""
        part = self.time <= time
        return Curve(self.time[part], self.temperature[part])

    def reaches(self, limit: float, t_env: float) -> float:
        """s after the peak until the curve falls to `limit`; beyond its end it goes on exponentially. NaN = never."""
        below = np.flatnonzero(self.temperature <= limit)
        if len(below):
            j = int(below[0])
            if j == 0:
                return float(self.time[0])
            t, y = self.time, self.temperature
            return float(t[j - 1] + (t[j] - t[j - 1]) * (y[j - 1] - limit) / (y[j - 1] - y[j]))
        tail = max(len(self.time) - 12, 0)
        rate = (self.temperature[-1] - self.temperature[tail]) / (self.time[-1] - self.time[tail])
        return float(self.time[-1] + cooling_wait(self.temperature[-1], rate, limit, t_env))


def predict(model: Curve, now: Curve, limit: float, t_env: float) -> float:
    """s from the end of `now` until it falls to `limit` if it goes on like `model`, its excess temperature scaled.

    NaN when the two have nothing in common.
    """
    late = now.time >= 0.5 * now.time[-1]
    expected = model.at(now.time[late]) - t_env
    scale = float((expected * (now.temperature[late] - t_env)).sum() / (expected**2).sum())
    if not SCALE[0] <= scale <= SCALE[1]:
        return math.nan
    scaled = Curve(model.time, t_env + scale * (model.temperature - t_env))
    return scaled.reaches(limit, t_env) - float(now.time[-1])


@dataclass
class CoolingModel:
    """Follows one pyrometer through the layers. `add` every believed sample, `wait` at any time."""

    t_env: float
    last: Curve | None = None
    before: Curve | None = None
    _times: list[float] = field(default_factory=list)
    _values: list[float] = field(default_factory=list)
    _lowest: float = math.inf

    def add(self, time: float, temperature: float) -> None:
        """A rise of `RISE` ends the dwell; while it still gets warmer, the dwell has not begun."""
        if temperature >= self._lowest + RISE:
            self.close()
        if self._values and temperature >= self._values[0]:
            self._times, self._values, self._lowest = [], [], math.inf
        if not self._times or time - self._times[-1] >= SPACING:
            self._times.append(time)
            self._values.append(temperature)
        self._lowest = min(self._lowest, temperature)

    def close(self) -> None:
        """The dwell is over or cut short (the pyrometer was wrong or silent): it is the model of the next one."""
        curve = self.dwell()
        if curve.usable:
            curve = curve.until(curve.time[int(np.argmin(curve.temperature))])
            self.last, self.before = curve, self.last
        self._times, self._values, self._lowest = [], [], math.inf

    def dwell(self) -> Curve:
        """The present dwell so far, smoothed over five samples."""
        y = np.array(self._values)
        if len(y) >= 5:
            y = np.convolve(np.pad(y, 2, 'edge'), np.full(5, 0.2), 'valid')
        return Curve(np.array(self._times) - (self._times[0] if self._times else 0.0), y)

    def wait(self, limit: float) -> float:
        """s until the present dwell reaches `limit`; NaN while nothing was learned or the layers are not alike."""
        if self.last is None or len(self._times) < 4:
            return math.nan
        now = self.dwell()
        if now.temperature[-1] <= limit:
            return 0.0
        wait = predict(self.last, now, limit, self.t_env)
        return max(wait * self._correction(now, limit), 0.0)

    def _correction(self, now: Curve, limit: float) -> float:
        """By what factor the same prediction, made at the same time of the last dwell, was short."""
        seen, last = float(now.time[-1]), self.last
        if last is None or self.before is None or seen >= last.time[-1]:
            return 1.0
        then = last.until(seen)
        same = float(np.clip(self._share(limit, last), last.temperature[-1], last.temperature[0]))
        true = last.reaches(same, self.t_env) - seen
        guess = predict(self.before, then, same, self.t_env) if len(then.time) >= 4 else math.nan
        if not (true > 0 and guess > 0):
            return 1.0
        return float(np.clip(true / guess, *TRUST))

    def _share(self, limit: float, last: Curve) -> float:
        """The temperature of the last dwell that is as far down from its peak as `limit` is in this one."""
        peak = self.dwell().temperature[0]
        ratio = (limit - self.t_env) / (peak - self.t_env)
        return self.t_env + ratio * (last.temperature[0] - self.t_env)
