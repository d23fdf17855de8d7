"""Heat: moving point source, feed compensation with the interpass temperature, cooling between
layers. SI; temperatures degC.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np


class HeatError(ValueError):
    """A temperature or length that the formula has no meaning for; the text names it."""


class HeatLaw(Protocol):
    """What eq 2.19 needs; `materials.Material` has it."""

    @property
    def kt(self) -> float: ...
    @property
    def kt_start(self) -> float: ...
    @property
    def kt_end(self) -> float: ...


def effective_power(current, voltage, arc_efficiency: float):
    """Q_eff = I*U*eta_th in W."""
    return np.asarray(current, float) * voltage * arc_efficiency


def heat_input(current, voltage, speed):
    """Arc energy per length I*U/V in J/m, before the arc's efficiency; speed m/s."""
    return np.asarray(current, float) * voltage / speed


def rosenthal(xi, r, power, speed, t0, conductivity, diffusivity):
    """Temperature in degC near a moving point source on a thick plate, eq 2.18 (Rykalin,
    Rosenthal), quasi-steady.

    T = T0 + Q_eff/(2*pi*lambda*r)*exp(-V*(r + xi)/(2*a)); xi: m ahead of the arc (behind is
    negative); r: m from the arc, above zero and at least |xi|; power W; speed m/s; conductivity
    W/(m K); diffusivity m2/s.
    """
    xi, r = np.asarray(xi, float), np.asarray(r, float)
    if not np.all(r > 0) or not np.all(r >= np.abs(xi) * (1 - 1e-9)):
        raise HeatError('r must be above zero and at least |xi|: it is the distance from the arc')
    return t0 + power / (2 * np.pi * conductivity * r) * np.exp(
        -speed * (r + xi) / (2 * diffusivity)
    )


def heat_factor(temperature, law: HeatLaw):
    """Factor of the wire feed by eq 2.19, 1 up to kt_start, then linear to its value at kt_end,
    constant beyond.

    The source's check (1 up to 200 degC, 0.85 at 400 degC, no step) fixes the reference temperature
    of the law at kt_start, not at the room's. Above kt_end nothing was checked, so the law is not
    extrapolated. NaN in, NaN out.
    """
    t = np.clip(np.asarray(temperature, float), law.kt_start, law.kt_end)
    return 1.0 - law.kt * (t - law.kt_start)


@dataclass(frozen=True)
class LumpedCooling:
    """A layer as one lump that loses heat in proportion to its excess temperature: dT/dt = -(T -
    t_env)/tau. tau s.
    """

    tau: float
    t_env: float

    @classmethod
    def from_rate(cls, temperature: float, rate: float, t_env: float) -> LumpedCooling | None:
        """The lump that cools at `rate` K/s at `temperature`; None when it does not cool or is no
        warmer than t_env.
        """
        excess = temperature - t_env
        if not (excess > 0 and rate < 0):
            return None
        return cls(-excess / rate, t_env)

    def temperature(self, start: float, time) -> np.ndarray:
        """degC after `time` s from `start` degC."""
        return self.t_env + (start - self.t_env) * np.exp(-np.asarray(time, float) / self.tau)

    def time_to(self, temperature: float, limit: float) -> float:
        """s until `limit` degC is reached, 0 when it is already, NaN when it never is (limit at or
        below t_env).
        """
        if temperature <= limit:
            return 0.0
        if limit <= self.t_env:
            return math.nan
        return self.tau * math.log((temperature - self.t_env) / (limit - self.t_env))


def cooling_wait(temperature: float, rate: float, limit: float, t_env: float) -> float:
    """s until a layer at `temperature` degC that changes at `rate` K/s reaches `limit`; 0 when
    below, NaN when unknown.
    """
    if temperature <= limit:
        return 0.0
    lump = LumpedCooling.from_rate(temperature, rate, t_env)
    return math.nan if lump is None else lump.time_to(temperature, limit)


@dataclass(frozen=True)
class LayerStack:
    """A growing part as one lump: every layer adds its metal and its heat, between layers it cools.

    energy: heat that a layer brings, J (arc efficiency included). heat_capacity: of one layer, J/K; base: of what lies
    below the first layer and warms up with it, J/K. loss: to the surroundings, W/K. t_env degC.
    """

    energy: float
    heat_capacity: float
    base: float
    loss: float
    t_env: float

    def __post_init__(self) -> None:
        for name in ('energy', 'heat_capacity', 'base', 'loss'):
            if not getattr(self, name) > 0:
                raise HeatError(f'{name} is {getattr(self, name)}, must be above zero')

    def interpass(self, layers: int, cycle: float) -> np.ndarray:
        """(layers,) degC before each layer when a layer and its pause take `cycle` s together; the first is t_env."""
        if layers < 1 or not cycle > 0:
            raise HeatError(f'layers ({layers}) must be at least 1, cycle ({cycle} s) above zero')
        out = np.full(layers, self.t_env)
        for n in range(1, layers):
            capacity = self.base + n * self.heat_capacity
            excess = (out[n - 1] - self.t_env) * (capacity - self.heat_capacity) / capacity
            excess += self.energy / capacity
            out[n] = self.t_env + excess * math.exp(-cycle * self.loss / capacity)
        return out

    def pause(self, layers: int, duration: float, limit: float) -> np.ndarray:
        """(layers,) s to wait before each layer so that it starts at or below `limit`; `duration`: s of laying one."""
        if limit <= self.t_env:
            raise HeatError(f'limit ({limit} degC) must be above t_env ({self.t_env} degC)')
        waits, before = np.zeros(layers), self.t_env
        for n in range(1, layers):
            capacity = self.base + n * self.heat_capacity
            excess = (before - self.t_env) * (capacity - self.heat_capacity) / capacity
            excess = (excess + self.energy / capacity) * math.exp(-duration * self.loss / capacity)
            lump = LumpedCooling(capacity / self.loss, self.t_env)
            waits[n] = lump.time_to(self.t_env + excess, limit)
            before = float(lump.temperature(self.t_env + excess, waits[n]))
        return waits
