"""The axes swing: modes of table and gantry, and the accelerometer that sees them. Lengths m, times s.

Each axis has two modes. A mode is a mass on a spring that the motion of the axes drags along: with q its lag behind the
commanded place, q'' + 2 D w q' + w^2 q = -n . a, where a is the commanded acceleration and n the direction of the mode.
The modes of X lean towards y by the coupling, those of Y as much the other way. Shares of the modes of an axis sum up
to 1, so the torch is off by sum(share q n) against the table, and the moving mass has the acceleration
-sum(share (2 D w q' + w^2 q) n). The frequency moves with the place of the axis and falls with the metal on the table.

The controller spreads the steps of a tick evenly, so the commanded speed is constant within a tick and changes between
two: every mode is pushed at the tick's begin and swings freely until its end, which is solved exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waam_node.params import param

from .compiled import SOURCES, jit, normal, record, state

GRAVITY = 9.80665  # m/s^2
STEEL = 7850.0  # kg/m^3, of what lies on the table
MODES = 4  # two of X, two of Y
TICK = 1e-3  # s
SENSOR_RATE = 3200.0  # samples of the accelerometer, 1/s: 32 in a step of the plant port
MIDDLE = (0.2, 0.15)  # m, machine: where the frequencies are those of the parameters


@dataclass(frozen=True)
class GantryParams:
    """How the axes swing, and the accelerometer on the moving mass."""

    on: bool = param(False, 'the axes swing; false = they are rigid')
    x_hz: float = param(41.0, 'first mode of X without damping', 'Hz', 3.0, 200.0)
    x_damping: float = param(0.05, 'damping ratio of it', '', 0.001, 0.5)
    x_second_hz: float = param(97.0, 'second mode of X', 'Hz', 3.0, 300.0)
    y_hz: float = param(33.0, 'first mode of Y without damping', 'Hz', 3.0, 200.0)
    y_damping: float = 0.06  # damping ratio of it
    y_second_hz: float = 83.0  # second mode of Y [Hz]
    second_damping: float = 0.04  # damping ratio of the second modes
    second_share: float = 0.1  # of the second modes; the first have the rest
    coupling: float = 0.05  # tangent by which a mode leans to the other axis
    hz_per_m: float = param(
        -0.2, 'relative change of the frequencies along their axis', '1/m', -2.0, 2.0
    )
    table_mass: float = 60.0  # what swings without a part [kg]
    sensor_noise: float = 0.04  # sigma of a sample of the accelerometer [m/s^2]
    sensor_range: float = 156.9  # it clips beyond [m/s^2]
    sensor_resolution: float = 0.0383  # of a sample [m/s^2]


@dataclass(frozen=True)
class Accelerations:
    """Samples of the accelerometer: controller time of the first in ns, values (n, 3) m/s^2 along x, y and z of the
    machine; z includes gravity."""

    time_ns: int
    values: np.ndarray


class Gantry:
    """`move` lets it live through samples. `deviation` (2,): torch against table, m, beside the commanded place."""

    def __init__(self, params: GantryParams, rng: np.ndarray, part_volume: float) -> None:
        """part_volume: m^3 of metal that is clamped on the table."""
        p = self.params = params
        first, second = 1.0 - p.second_share, p.second_share
        norm = math.hypot(1.0, p.coupling)
        x, y = (1.0 / norm, p.coupling / norm), (-p.coupling / norm, 1.0 / norm)
        self.modes = np.array(
            [
                (2 * math.pi * p.x_hz, p.x_damping, first, *x, 0.0),
                (2 * math.pi * p.x_second_hz, p.second_damping, second, *x, 0.0),
                (2 * math.pi * p.y_hz, p.y_damping, first, *y, 1.0),
                (2 * math.pi * p.y_second_hz, p.second_damping, second, *y, 1.0),
            ]
        )
        self._part = part_volume
        self._swing = np.zeros((MODES, 2))  # lag and its speed
        self._state = state('x', 'y', 'vx', 'vy', 'known', 'due')
        self._state['due'] = 0.5 / SENSOR_RATE
        self._record, self._rng = record(p), rng
        self._count = 0
        self._values = np.empty((0, 3))
        self.deviation = np.zeros(2)

    def load(self, deposited: float) -> float:
        """Factor of the frequencies with so much metal (m^3) on top of the part."""
        p = self.params
        return math.sqrt(p.table_mass / (p.table_mass + STEEL * (self._part + deposited)))

    def hz(self, mode: int, place: float, deposited: float = 0.0) -> float:
        """Frequency (Hz, without damping) of a mode with its axis at `place` (m, machine)."""
        omega, axis = self.modes[mode, 0], int(self.modes[mode, 5])
        shift = 1.0 + self.params.hz_per_m * (place - MIDDLE[axis])
        return float(omega / (2 * math.pi) * shift * self.load(deposited))

    def move(self, samples: np.ndarray, deposited: float, sensing: bool) -> np.ndarray:
        """The samples as torch and table really moved. deposited: m^3 of metal laid so far; sensing: the accelerometer
        is on."""
        moved = samples.copy()
        most = int(len(samples) * TICK * SENSOR_RATE) + 2
        if len(self._values) < most:
            self._values = np.empty((most, 3))
        self._count = swing(
            samples=moved, params=self._record, modes=self.modes, swings=self._swing, states=self._state,
            rng=self._rng, load=self.load(deposited), sensing=sensing, values=self._values, deviation=self.deviation,
        )  # fmt: skip
        return moved

    def accelerations(self, time_us: int) -> Accelerations | None:
        """The samples of the step that ended at `time_us`; None when there are none."""
        if not self._count:
            return None
        ago = self._count / SENSOR_RATE - float(self._state['due'][0])  # due: the next one
        first = time_us * 1000 - round(ago * 1e9)
        return Accelerations(first, self._values[: self._count].copy())


@jit
def free(q, speed, omega, damping, dt):
    """Lag and speed of a mode after `dt` s without a push."""
    damped = omega * math.sqrt(1.0 - damping * damping)
    left = math.exp(-damping * omega * dt)
    c, s = math.cos(damped * dt), math.sin(damped * dt) / damped
    return (
        left * (q * (c + damping * omega * s) + speed * s),
        left * (speed * (c - damping * omega * s) - q * omega * omega * s),
    )


def _make_swing(sources: int) -> Callable:
    @jit
    def sense(p, rng, modes, swings, omegas, out):
        """One sample (3,) of the accelerometer."""
        out[:] = 0.0
        for k in range(MODES):
            force = 2.0 * modes[k, 1] * omegas[k] * swings[k, 1] + omegas[k] ** 2 * swings[k, 0]
            out[0] -= modes[k, 2] * modes[k, 3] * force
            out[1] -= modes[k, 2] * modes[k, 4] * force
        out[2] = GRAVITY
        for i in range(3):
            said = out[i] + p.sensor_noise * normal(rng)
            said = p.sensor_resolution * round(said / p.sensor_resolution)
            out[i] = min(max(said, -p.sensor_range), p.sensor_range)

    @jit
    def swing(samples, params, modes, swings, states, rng, load, sensing, values, deviation):
        """Moves the table of every sample by what the modes add. Returns how many samples went into `values`."""
        if not sources:
            return 0
        p, s = params[0], states[0]
        omegas = np.empty(MODES)
        count = 0
        for i in range(samples.size):
            x, y = -samples[i].table_x, -samples[i].table_y
            if s.known == 0.0:
                s.x, s.y, s.known = x, y, 1.0
            vx, vy = (x - s.x) / TICK, (y - s.y) / TICK
            for k in range(MODES):
                along = x - MIDDLE[0] if modes[k, 5] == 0.0 else y - MIDDLE[1]
                omegas[k] = modes[k, 0] * load * (1.0 + p.hz_per_m * along)
                swings[k, 1] -= modes[k, 3] * (vx - s.vx) + modes[k, 4] * (vy - s.vy)
            s.x, s.y, s.vx, s.vy = x, y, vx, vy
            left = TICK
            while sensing and s.due <= left:
                for k in range(MODES):
                    swings[k] = free(swings[k, 0], swings[k, 1], omegas[k], modes[k, 1], s.due)
                sense(p, rng, modes, swings, omegas, values[count])
                count += 1
                left -= s.due
                s.due = 1.0 / SENSOR_RATE
            for k in range(MODES):
                swings[k] = free(swings[k, 0], swings[k, 1], omegas[k], modes[k, 1], left)
            s.due = s.due - left if sensing else 0.5 / SENSOR_RATE  # never at the end of a step
            deviation[0] = deviation[1] = 0.0
            for k in range(MODES):
                deviation[0] += modes[k, 2] * modes[k, 3] * swings[k, 0]
                deviation[1] += modes[k, 2] * modes[k, 4] * swings[k, 0]
            samples[i].table_x -= deviation[0]
            samples[i].table_y -= deviation[1]
        return count

    return swing


swing = _make_swing(SOURCES)
