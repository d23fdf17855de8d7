"""Holds arc current, power or heat input by the feed override (source 004): telemetry in, factors out. Pure.

What is wanted changes along the path: the corrections choose feed and speed of every segment, the operator multiplies
both. The reference follows all of that, so that none of it is an error to the control; an error is only what the
process does on its own. Voltage is not its business: the arc regulator holds it, so reference and measurement take the
same one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from waam_process.materials import CURRENT_EXPONENT
from waam_process.operating import SPEED_FACTOR, WIRE_FACTOR

from .params import ProcessControlParams, reference
from .pid import Gains, VelocityPid

STILL = 1e-3  # m/s, slower is standing
STEADY = 0.05  # relative change of the travel speed within WINDOW that is no corner
WINDOW = 0.1  # s
PERIOD = 0.04  # s between two steps of the control
FILTER = 0.05  # s, time constant of what is measured
FACTOR_LOW, FACTOR_HIGH = 0.8, 1.25  # of what is asked for
GAP = 0.2  # s of controller time without telemetry after which measurements begin anew
KNOWN = 0.3  # s for which nothing was asked for: the override in telemetry is the operator's


class Sample(NamedTuple):
    """One telemetry frame. SI."""

    t: float  # s, controller clock
    current: float
    voltage: float
    speed: float  # travel
    feed: float  # commanded
    arc: bool  # established
    speed_override: float  # in force
    wire_override: float


class Factors(NamedTuple):
    """Beside the operator's."""

    speed: float = 1.0
    wire: float = 1.0


@dataclass
class Status:
    """What the control does. `reason`: why it is frozen, '' = it acts."""

    reference: float = math.nan
    measured: float = math.nan
    reason: str = 'no arc'
    limited: bool = False


def exponent(value: str, keep_metal: bool) -> float:
    """d ln(value) / d ln(factor): current goes with feed^0.65, heat input with 1 / speed."""
    if value == 'heat_input':
        return CURRENT_EXPONENT - 1.0 if keep_metal else -1.0
    return CURRENT_EXPONENT


class ProcessControl:
    """`add` takes every telemetry frame; `factors` is what is asked for."""

    def __init__(self, params: ProcessControlParams) -> None:
        self.params, self.material, self.level = params, params.of_material, params.level
        self.law = VelocityPid(Gains(params.kp, params.ki))
        self.status = Status()
        self.factors = Factors()
        self.operator = Factors()
        self._exponent = exponent(params.value, params.keep_metal)
        self._means: list[float] = []  # filtered current, voltage, speed, feed
        self._speeds: list[tuple[float, float]] = []  # time and programmed speed within WINDOW
        self._t = self._stepped = self._lit = -math.inf
        self._unsteady = self._asked = -math.inf

    def on_operator(self, speed: float, wire: float) -> None:
        """The operator's factors; NaN leaves one as it is."""
        old = self.operator
        self.operator = Factors(
            old.speed if math.isnan(speed) else speed, old.wire if math.isnan(wire) else wire
        )

    def freeze(self, reason: str) -> None:
        """The factors stay as they are."""
        self.status.reason = reason
        self.law.freeze()

    def add(self, s: Sample) -> Factors | None:
        """The factors when a step was due, else None."""
        self._learn_operator(s)
        if not 0 < s.t - self._t < GAP:
            self._forget(s.t)
            self._asked = min(self._asked, s.t)
            self._stepped = s.t - PERIOD
        self._filter(s)
        if s.t - self._stepped < PERIOD - 1e-6:
            return None
        dt = min(s.t - self._stepped, 2 * PERIOD)
        self._stepped = s.t
        self._step(s, dt)
        if self.factors != (1.0, 1.0):
            self._asked = s.t
        return self.factors

    def _learn_operator(self, s: Sample) -> None:
        """A control that was started late, or a controller that was, has not heard what the operator said."""
        if s.t - self._asked > KNOWN and s.speed_override > 0 and s.wire_override > 0:
            self.operator = Factors(s.speed_override, s.wire_override)

    def _forget(self, t: float) -> None:
        self._means, self._speeds, self._lit = [], [], t

    def _filter(self, s: Sample) -> None:
        before = self._t
        self._t = s.t
        own_speed, own_wire = (
            s.speed_override / self.operator.speed,
            s.wire_override / self.operator.wire,
        )
        wanted_speed, wanted_feed = s.speed / own_speed, s.feed / own_wire
        if not s.arc:
            self._forget(s.t)
            return
        new = [s.current, s.voltage, s.speed, wanted_speed, wanted_feed]
        share = 1.0 if not self._means else (s.t - before) / (FILTER + s.t - before)
        old = self._means or new
        self._means = [a + share * (b - a) for a, b in zip(old, new, strict=True)]
        self._speeds = [v for v in self._speeds if s.t - v[0] <= WINDOW] + [(s.t, wanted_speed)]
        seen = [v for _, v in self._speeds]
        if max(seen) - min(seen) > STEADY * max(seen) or s.speed < STILL:
            self._unsteady = s.t

    def _why_frozen(self, s: Sample) -> str:
        if not s.arc:
            return 'no arc'
        if s.t - self._lit < self.params.settle:
            return 'the arc has just started'
        if s.speed < STILL:
            return 'the torch stands'
        if s.t - self._unsteady < WINDOW + FILTER:
            return 'the travel speed changes'
        return ''

    def _step(self, s: Sample, dt: float) -> None:
        status = self.status
        status.reason = self._why_frozen(s)
        if s.arc:
            current, voltage, speed, wanted_speed, wanted_feed = self._means
            due = self.level * self.material.set_current(max(wanted_feed, 1e-6))
            value = self.params.value
            status.reference = reference(value, due, voltage, wanted_speed)
            status.measured = reference(value, current, voltage, speed)
        else:
            status.reference = status.measured = math.nan
        error = 1.0 - status.measured / status.reference if s.arc else math.nan
        if status.reason or not math.isfinite(error):
            self.law.freeze()
        else:
            low, high = self._limits()
            self.law.step(error, dt, low, high)
            status.limited = not low < self.law.output < high
        self.factors = self._of(self.law.output) if s.arc else Factors()

    def _limits(self) -> tuple[float, float]:
        """Of the law's output: those of the factors, and of their product with the operator's."""
        low, high = FACTOR_LOW, FACTOR_HIGH
        for moved, own, (least, most) in zip(
            self._moved(), self.operator, (SPEED_FACTOR, WIRE_FACTOR), strict=True
        ):
            if moved:
                low, high = max(low, min(least / own, 1.0)), min(high, max(most / own, 1.0))
        ends = sorted((low**self._exponent, high**self._exponent))
        return ends[0], ends[1]

    def _moved(self) -> tuple[bool, bool]:
        """Whether speed and wire are moved."""
        by_speed = self.params.value == 'heat_input'
        return by_speed or self.params.keep_metal, not by_speed or self.params.keep_metal

    def _of(self, output: float) -> Factors:
        factor = output ** (1.0 / self._exponent)
        speed, wire = self._moved()
        return Factors(factor if speed else 1.0, factor if wire else 1.0)
