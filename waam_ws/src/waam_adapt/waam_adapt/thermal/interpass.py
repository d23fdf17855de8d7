"""Interpass logic: is the pyrometer to be believed, how warm is the layer, may the next one start,
and if not, when.

Pure and driven by samples: the caller gives times (s, any one clock that only goes forward) and
temperatures (degC).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from waam_process.heat import cooling_wait, heat_factor
from waam_process.materials import Material

from .cooling import CoolingModel
from .response import ResponseWatch


@dataclass(frozen=True)
class Settings:
    """Limits of belief. Temperatures degC, differences K, times s."""

    interpass_limit: float  # the next layer starts at or below this
    t_min: float = -20.0  # what the pyrometer can measure
    t_max: float = 1400.0
    jump: float = 150.0  # change between samples that no layer makes
    confirm: int = 5  # samples in a row that prove a jump
    step: float = 40.0  # fall between samples that no metal cools by: emissivity or view changed
    step_top: float = 800.0  # above this temperature metal may cool that fast
    hold: float = 10.0  # time after a step that nothing is plausible
    stuck_time: float = 10.0  # a reading that rests for so long is frozen
    stuck_band: float = 0.01  # and rests means: moves less than this
    timeout: float = 2.0  # silence after which nothing is plausible
    window: float = 3.0  # over which temperature and rate are fitted


@dataclass(frozen=True)
class Heat:
    """What is known at one moment."""

    factor: float  # of the wire feed, eq 2.19
    temperature: float  # degC, NaN before the first sample
    rate: float  # K/s
    ready: bool  # plausible and at or below the limit
    wait: float  # s until ready, 0 = ready, NaN = unknown
    plausible: bool  # the readings can be true
    reasons: tuple[str, ...]  # why they cannot
    doubt: str = ''  # why the spot does not seem to lie on the layer, '' = nothing against it

    @property
    def believed(self) -> bool:
        """The temperature answers to the layers (or no layer has been laid yet)."""
        return not self.doubt


class InterpassMonitor:
    """Follows one pyrometer. `add` every sample, `state` at any time.

    `response` follows the layers that the arc lays, and doubts a temperature that does not answer to them.
    """

    def __init__(self, material: Material, settings: Settings) -> None:
        self.material, self.settings = material, settings
        self.response = ResponseWatch(material)
        # why the law of the material that is laid is not known; then nothing is ready
        self.material_error = ''
        self._samples: deque[tuple[float, float]] = deque(maxlen=1000)
        self._suspects: list[tuple[float, float]] = []
        self._last_heard = -math.inf
        self._last_value = math.nan
        self._still_since = math.nan
        self._fault = ''
        self._stepped, self._step_time = 0.0, -math.inf
        self.cooling = CoolingModel(material.t_env)

    def use(self, material: Material, interpass_limit: float) -> None:
        """From now on the law and the limit (degC) of this material; what was learned of another one is dropped."""
        self.settings = replace(self.settings, interpass_limit=interpass_limit)
        self.material_error = ''
        if material == self.material:
            return
        self.material = material
        self.cooling = CoolingModel(material.t_env)
        self.response.material = material

    def add(self, time: float, temperature: float) -> None:
        """Takes one sample. Samples out of order are ignored, a clock that was set back starts
        afresh.
        """
        s = self.settings
        if time < self._last_heard - s.timeout or time > self._last_heard + s.timeout:
            self._samples.clear()
            self._suspects.clear()
            self._still_since = time
            self.cooling.close()
        elif time <= self._last_heard:
            return
        self._last_heard = time
        self._fault = ''
        if not math.isfinite(temperature):
            self._fault = 'pyrometer gives no number'
        elif not s.t_min <= temperature <= s.t_max:
            self._fault = (
                f'pyrometer reads {temperature:.0f} degC, outside {s.t_min:.0f} .. {s.t_max:.0f}'
            )
        else:
            self._watch_stillness(time, temperature)
            self._accept(time, temperature)

    def _watch_stillness(self, time: float, temperature: float) -> None:
        s = self.settings
        if not abs(temperature - self._last_value) <= s.stuck_band:
            self._last_value, self._still_since = temperature, time

    def _accept(self, time: float, temperature: float) -> None:
        """Into the window, unless it jumps; a jump that `confirm` samples agree on is the new
        level.
        """
        s = self.settings
        if not self._samples or abs(temperature - self._samples[-1][1]) <= s.jump:
            self._watch_step(time, temperature)
            self._samples.append((time, temperature))
            self._suspects.clear()
            self._learn(time, temperature)
        else:
            if self._suspects and abs(temperature - self._suspects[-1][1]) > s.jump:
                self._suspects.clear()
            self._suspects.append((time, temperature))
            if len(self._suspects) >= s.confirm:
                self._take_level()
        while self._samples[-1][0] - self._samples[0][0] > s.window:
            self._samples.popleft()

    def _take_level(self) -> None:
        """The suspects are right: the layer got hot or, if they are far below, the pyrometer sees something else."""
        if self._suspects[-1][1] < self._samples[-1][1]:
            self._mark_step(self._suspects[-1][0], self._suspects[-1][1] - self._samples[-1][1])
        self._samples.clear()
        self._samples.extend(self._suspects)
        self._suspects.clear()
        for time, temperature in self._samples:
            self._learn(time, temperature)

    def _learn(self, time: float, temperature: float) -> None:
        self.cooling.add(time, temperature)
        self.response.add(time, temperature)

    def _watch_step(self, time: float, temperature: float) -> None:
        s = self.settings
        if not self._samples or self._samples[-1][1] > s.step_top:
            return
        change = temperature - self._samples[-1][1]
        if change < -s.step and time - self._samples[-1][0] <= 0.5:
            self._samples.clear()
            self._mark_step(time, change)

    def _mark_step(self, time: float, change: float) -> None:
        self._stepped, self._step_time = change, time
        self.cooling.close()

    def state(self, now: float) -> Heat:
        """What is known at time `now` (s, clock of the samples). Not plausible: factor 1, not
        ready, wait unknown.
        """
        m, s = self.material, self.settings
        temperature, rate = self._fit()
        reasons, doubt = self._reasons(now), self.response.doubt()
        if reasons:
            return Heat(
                factor=1.0,
                temperature=temperature,
                rate=rate,
                ready=False,
                wait=math.nan,
                plausible=False,
                reasons=reasons,
                doubt=doubt,
            )
        ready = temperature <= s.interpass_limit
        wait = self._wait(temperature, rate)
        factor = float(heat_factor(temperature, m))
        return Heat(
            factor=factor,
            temperature=temperature,
            rate=rate,
            ready=ready,
            wait=wait,
            plausible=True,
            reasons=(),
            doubt=doubt,
        )

    def _wait(self, temperature: float, rate: float) -> float:
        """By the curve of the layers before; for the first ones as one lump that cools at the present rate."""
        limit = self.settings.interpass_limit
        if temperature <= limit:
            return 0.0
        learned = self.cooling.wait(limit)
        if math.isfinite(learned):
            return learned
        return cooling_wait(temperature, rate, limit, self.material.t_env)

    def _reasons(self, now: float) -> tuple[str, ...]:
        s, reasons = self.settings, []
        if self.material_error:
            reasons.append(self.material_error)
        silent = now - self._last_heard
        if not self._samples:
            reasons.append('no usable temperature yet')
        if math.isfinite(silent) and silent > s.timeout:
            reasons.append(f'pyrometer silent for {silent:.1f} s')
        if self._fault:
            reasons.append(self._fault)
        if self._suspects:
            reasons.append(f'pyrometer jumped to {self._suspects[-1][1]:.0f} degC')
        if self._last_heard - self._step_time < s.hold:
            reasons.append(
                f'pyrometer stepped by {self._stepped:.0f} K: emissivity or view changed'
            )
        still = self._last_heard - self._still_since
        if s.stuck_time > 0 and still >= s.stuck_time:
            reasons.append(f'pyrometer stuck at {self._last_value:.1f} degC for {still:.0f} s')
        return tuple(reasons)

    def _fit(self) -> tuple[float, float]:
        """Temperature at the newest sample and rate: straight line through the window (the median
        below 5 samples).
        """
        if not self._samples:
            return math.nan, math.nan
        t, y = np.array(self._samples).T
        if len(t) < 5:
            return float(np.median(y)), math.nan
        t = t - t[-1]
        rate = float(
            ((t - t.mean()) * (y - y.mean())).sum() / max(((t - t.mean()) ** 2).sum(), 1e-12)
        )
        return float(y.mean() - rate * t.mean()), rate
