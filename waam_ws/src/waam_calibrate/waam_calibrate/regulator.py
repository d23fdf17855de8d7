"""Gains of the arc regulator on its plant: rules, phase margin, step response. Pure. V, s.

The plant is gain e^(-delay s) / (lag s + 1), the regulator a PID with filtered derivative, as in the controller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

TICK = 1e-4  # s, of the step response
MARGIN = 30.0  # deg, asked for by source 000


@dataclass(frozen=True)
class Plant:
    """gain e^(-delay s) / (lag s + 1)"""

    gain: float
    lag: float
    delay: float


@dataclass(frozen=True)
class Gains:
    """PID with filtered derivative: kp + ki / s + kd s / (filter s + 1)."""

    kp: float
    ki: float
    kd: float
    filter: float


@dataclass(frozen=True)
class Swing:
    """A relay experiment, one entry per sample: time in s; output of the relay and voltage of the arc in V."""

    time: np.ndarray
    output: np.ndarray
    voltage: np.ndarray


SHIPPED = Gains(2.11, 43.7, 0.0062, 0.0035)  # fixed gains of the controller (waam_config.c)


def ziegler_nichols(ku: float, tu: float) -> Gains:
    """Kp = 0.6 Ku, Ti = Tu / 2, Td = Tu / 8 (1942); the derivative filtered at a tenth of Td."""
    kp = 0.6 * ku
    return Gains(kp, kp / (0.5 * tu), kp * tu / 8, tu / 80)


def analytic(plant: Plant) -> Gains:
    """PI that cancels the lag and closes the loop with the time constant of the delay (Skogestad 2003, SIMC)."""
    kp = plant.lag / (2 * plant.gain * plant.delay)
    return Gains(kp, kp / min(plant.lag, 8 * plant.delay), 0.0, 0.0)


def simulate(plant: Plant, output: np.ndarray, step: float) -> np.ndarray:
    """Change of the voltage (n,) by outputs (n,) every `step` s."""
    keep = math.exp(-step / plant.lag)
    at = np.arange(len(output)) * step
    late = np.interp(at - plant.delay, at, output)
    return np.asarray(plant.gain * lfilter([1 - keep], [1, -keep], late, zi=[keep * late[0]])[0])


def experiment(plant: Plant, amplitude: float = 2.0, noise: float = 0.05, seed: int = 1) -> Swing:
    """A rehearsal, 10 kHz: 0.3 s at 22 V, then a relay of +-amplitude with its setpoint 0.3 amplitudes higher.
    noise: of a voltage reading, V; the relay has a hysteresis of three times that."""
    dt, middle, target = 1e-4, 22.0, 0.3 * amplitude * plant.gain
    begin = round(0.3 / dt)
    n = begin + round(25 * 5 * plant.delay / dt)
    readings = noise * np.random.default_rng(seed).standard_normal(n)
    keep, late = math.exp(-dt / plant.lag), max(1, round(plant.delay / dt))
    out, v = np.zeros(n + late), np.zeros(n)
    now, side = 0.0, 1.0
    for k in range(n):
        now += (1 - keep) * (plant.gain * (out[k - late] if k >= late else 0.0) - now)
        v[k] = now + readings[k]
        if abs(v[k] - target) > 3 * noise:
            side = -math.copysign(1.0, v[k] - target)
        out[k] = side * amplitude if k >= begin else 0.0
    return Swing(dt * np.arange(n), middle + out[:n], middle + v)


def margin(gains: Gains, plant: Plant) -> float:
    """Phase margin in degrees, the smallest of all crossings; 180 where the loop never reaches 1."""
    w = np.logspace(-1, 1, 4001) / plant.delay
    s = 1j * w
    loop = (gains.kp + gains.ki / s + gains.kd * s / (gains.filter * s + 1)) * plant.gain
    loop *= np.exp(-plant.delay * s) / (plant.lag * s + 1)
    size, angle = np.log(np.abs(loop)), np.unwrap(np.angle(loop))
    angle -= 2 * math.pi * round((angle[0] + math.pi / 2) / (2 * math.pi))
    at = np.flatnonzero((size[:-1] >= 0) != (size[1:] >= 0))
    return min((180 + math.degrees(float(angle[i])) for i in at), default=180.0)


def step_response(gains: Gains, plant: Plant, seconds: float = 0.4) -> np.ndarray:
    """Voltage (n,) over a step of the setpoint by 1, every TICK."""
    dt = TICK
    n, late = round(seconds / dt), round(plant.delay / dt)
    keep, smooth = math.exp(-dt / plant.lag), dt / (gains.filter + dt)
    u, v = np.zeros(n + late + 1), np.zeros(n)
    total, slope, before, now = 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        error = 1.0 - now
        total += gains.ki * error * dt
        slope += smooth * (gains.kd * (error - before) / dt - slope)
        before = error
        u[k + late] = gains.kp * error + total + slope
        now += (1 - keep) * (plant.gain * u[k] - now)
        v[k] = now
    return v


def overshoot(response: np.ndarray) -> float:
    """Share of the step."""
    return max(0.0, float(response.max()) - 1.0)


def settling(response: np.ndarray) -> float:
    """s until it stays within 2 %; infinite when it does not."""
    outside = np.flatnonzero(~(np.abs(response - 1.0) <= 0.02))
    if not len(outside):
        return 0.0
    return math.inf if outside[-1] + 1 == len(response) else float(outside[-1] + 1) * TICK
