"""Heat: moving point source, feed compensation with the interpass temperature, cooling between
layers. SI; temperatures degC.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

Value: TypeAlias = float | np.ndarray


class HeatError(ValueError):
    """A temperature or length for which the formula is not defined; the text names it."""


class HeatLaw(Protocol):
    """What eq 2.19 needs; `materials.Material` has it."""

    @property
    def kt(self) -> float:
        """Slope of the feed compensation, 1/K (eq 2.19)."""

    @property
    def kt_start(self) -> float:
        """Temperature from which on the feed is reduced, degC."""

    @property
    def kt_end(self) -> float:
        """Temperature above which it is not reduced any further, degC."""


def effective_power(current: Value, voltage: Value, arc_efficiency: float) -> np.ndarray:
    """Q_eff = I*U*eta_th in W."""
    return np.asarray(current, float) * voltage * arc_efficiency


def heat_input(current: Value, voltage: Value, speed: Value) -> np.ndarray:
    """Arc energy per length I*U/V in J/m, before the arc's efficiency; speed m/s."""
    return np.asarray(current, float) * voltage / speed


def rosenthal(
    xi: Value,
    r: Value,
    power: float,
    speed: float,
    t0: float,
    conductivity: float,
    diffusivity: float,
) -> np.ndarray:
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


@dataclass(frozen=True)
class ArcPass:
    """What an arc brought along its path."""

    power: float  # W that stay in the metal (`effective_power`)
    speed: float  # m/s of travel
    duration: float  # s

    @property
    def energy(self) -> float:
        """J that stay in the metal."""
        return self.power * self.duration


def least_peak_rise(
    arc: ArcPass, distance: float, conductivity: float, diffusivity: float
) -> float:
    """Least temperature rise in K at its peak, `distance` m from the path that the arc went along.

    The metal is taken for half-infinite, the largest heat sink that there is, so a real part gets warmer. Two peaks
    are compared. A long path: the largest value of eq 2.18 over all places beside the path. A short path: all the
    energy at one point at once, T - T0 = 2*E/(rho*c*(4*pi*a*t)^1.5)*exp(-r^2/(4*a*t)), which peaks at
    t = r^2/(6*a) (Carslaw and Jaeger, Conduction of Heat in Solids, 2nd ed. 1959, section 10.2). The lower one
    counts. distance above zero; W/(m K); m2/s.
    """
    if not (distance > 0 and arc.speed > 0):
        raise HeatError(f'distance ({distance} m) and speed ({arc.speed} m/s) must be above zero')
    r = distance * np.geomspace(1.0, 30.0, 400)
    behind = -np.sqrt(r**2 - distance**2)
    moving = rosenthal(
        xi=behind,
        r=r,
        power=arc.power,
        speed=arc.speed,
        t0=0.0,
        conductivity=conductivity,
        diffusivity=diffusivity,
    ).max()
    capacity = conductivity / diffusivity  # J/(m3 K)
    at_once = 2 * arc.energy / (capacity * distance**3) * (3 / (2 * np.pi * math.e)) ** 1.5
    return float(min(moving, at_once))


def heat_factor(temperature: Value, law: HeatLaw) -> np.ndarray:
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

    def temperature(self, start: float, time: Value) -> np.ndarray:
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
