"""The controller's arc regulator (its real C code, through the library waam_arc_loop) around plants of our own.

Used by test_arc_regulator.py. Times s, voltages V, currents A, wire speed mm/s.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from functools import cache

import loop_library
import numpy as np

TS = 1e-4
LAG, DELAY = 0.05, 0.01  # of the plant k/(T s + 1) with dead time
GAINS = tuple(0.5 + 0.1 * i for i in range(11))  # nominal gain 1, +-50 %
BAND = 0.02  # settled: within 2 % of the step
REACTED = 0.1  # reacted: within 10 % of the disturbance
SETPOINT = 22.0


@cache
def _library() -> ctypes.CDLL:
    lib = loop_library.load('arc_loop')
    lib.arc_loop_start.argtypes = [ctypes.c_bool, ctypes.c_bool, ctypes.c_float * 4, ctypes.c_float]
    lib.arc_loop_start.restype = ctypes.c_char_p
    lib.arc_loop_step.argtypes = [ctypes.c_float] * 4
    lib.arc_loop_step.restype = ctypes.c_float
    return lib


@dataclass(frozen=True)
class Variant:
    """What regulates. `gains`: (kp, ki, kd, filter_s) instead of the shipped fixed ones."""

    scheduling: bool = False
    predictor: bool = False
    gains: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def start(self) -> None:
        """Begins a new loop; raises ValueError for a configuration that the core refuses."""
        gains = (ctypes.c_float * 4)(*self.gains)
        wrong = _library().arc_loop_start(self.scheduling, self.predictor, gains, 0.0)
        if wrong:
            raise ValueError(wrong.decode())


FIXED = Variant()
SCHEDULED = Variant(scheduling=True, predictor=True)
# The fastest PID with at most 5 % overshoot at the nominal gain alone, by the search in doc/arc_regulator.md.
# The fastest fixed gains that never raise the current by more than 1 % of its dip, 80 to 250 A, gain up to 10 % off.
CALM = Variant(gains=(2.01, 40.1, 0.0058, 0.0014))
TRIM = 15.0  # V that the source may be moved away from its setpoint, as shipped


def step(setpoint: float, voltage: float, current: float = 120.0, wire: float = 87.0) -> float:
    """One fast tick: arc in, source setpoint out."""
    return _library().arc_loop_step(setpoint, voltage, current, wire)


def tuning() -> dict[str, float]:
    """Coefficients in force."""
    values = (ctypes.c_float * 9)()
    _library().arc_loop_tuning(values)
    names = ('p', 'i', 'd', 'smooth', 'weight', 'gain', 'predict', 'lag', 'delay')
    return dict(zip(names, values, strict=True))


class Plant:
    """gain e^(-delay s) / (lag s + 1) around the point where output and voltage are SETPOINT; exact for steps."""

    def __init__(self, gain: float, lag: float = LAG, delay: float = DELAY) -> None:
        self._keep = math.exp(-TS / lag) if lag else 0.0
        self._gain = gain
        self._under_way = [0.0] * round(delay / TS)
        self.change = 0.0  # of the voltage, by what was put out

    def advance(self, output: float) -> None:
        """One sample."""
        self._under_way.append(output - SETPOINT)
        target = self._gain * self._under_way.pop(0)
        self.change = target + self._keep * (self.change - target)


def setpoint_step(
    variant: Variant,
    gain: float,
    seconds: float = 0.4,
    height: float = 1.0,
    delay: float = DELAY,
    current: float = 120.0,
    wire: float = 87.0,
) -> np.ndarray:
    """Voltage over its step, per unit, one value per sample, beginning with the step."""
    variant.start()
    plant, rows = Plant(gain, delay=delay), []
    before = 5000 if variant.scheduling else 50
    for k in range(before + round(seconds / TS)):
        wanted = SETPOINT + (height if k >= before else 0.0)
        plant.advance(step(wanted, SETPOINT + plant.change, current, wire))
        rows.append(plant.change / height)
    return np.array(rows[before:])


def overshoot(response: np.ndarray) -> float:
    """Share of the step."""
    return max(0.0, float(response.max()) - 1.0)


def settling(response: np.ndarray) -> float:
    """s from the step until it stays within BAND; infinite when it does not before the end."""
    outside = np.flatnonzero(~(np.abs(response - 1.0) <= BAND))
    if not len(outside):
        return 0.0
    return math.inf if outside[-1] + 1 == len(response) else float(outside[-1] + 1) * TS


# ---- frequency response


def loop_computed(gain: float, frequency: np.ndarray) -> np.ndarray:
    """Open loop at angular frequencies (rad/s), from the coefficients that are in force (z transform)."""
    c = tuning()
    back = np.exp(-1j * frequency * TS)  # one sample of delay
    slope = c['d'] * (1 - back) * c['smooth'] / (1 - (1 - c['smooth']) * back)
    controller = c['p'] + c['i'] / (1 - back) + slope
    if c['predict']:
        share = TS / (c['lag'] + TS)
        model = c['gain'] * share * back / (1 - (1 - share) * back)
        controller = controller / (1 + controller * model * (1 - back ** round(c['delay'] / TS)))
    keep = math.exp(-TS / LAG)
    plant = gain * (1 - keep) * back / (1 - keep * back)
    return controller * plant * back ** round(DELAY / TS)


def controller_measured(variant: Variant, frequency: float, amplitude: float = 0.05) -> complex:
    """Response of the running C code to a sinusoidal arc voltage at one angular frequency (rad/s), least squares."""
    variant.start()
    period = 2 * math.pi / frequency
    settle, length = round(0.7 / TS), round(max(3, math.ceil(0.3 / period)) * period / TS)
    k = np.arange(settle + length)
    sine = SETPOINT + amplitude * np.sin(frequency * TS * k)
    out = np.array([step(SETPOINT, float(v)) for v in sine])[settle:]
    phase = frequency * TS * k[settle:]
    columns = np.column_stack(
        [np.sin(phase), np.cos(phase), np.ones(length), np.linspace(-1, 1, length)]
    )
    a, b, *_ = np.linalg.lstsq(columns, out, rcond=None)[0]
    return -complex(a, b) / amplitude


def phase_margin(frequency: np.ndarray, loop: np.ndarray) -> tuple[float, float]:
    """Smallest phase margin (degrees) and its crossover (rad/s) of an open loop given at rising frequencies."""
    size = np.log(np.abs(loop))
    crossings = np.flatnonzero((size[:-1] >= 0) != (size[1:] >= 0))
    if not len(crossings):
        return math.nan, math.nan
    angle = np.unwrap(np.angle(loop))
    angle -= 2 * math.pi * round((angle[0] + math.pi / 2) / (2 * math.pi))
    found = []
    for i in crossings:
        f = size[i] / (size[i] - size[i + 1])
        at = frequency[i] * (frequency[i + 1] / frequency[i]) ** f
        found.append((180 + math.degrees(angle[i] + f * (angle[i + 1] - angle[i])), float(at)))
    return min(found)


def margin_computed(variant: Variant, gain: float) -> tuple[float, float]:
    """Phase margin (degrees) and crossover (rad/s) from the coefficients in force."""
    variant.start()
    for _ in range(5000 if variant.scheduling else 20):
        step(SETPOINT, SETPOINT)
    frequency = np.logspace(0, 4, 8000)
    return phase_margin(frequency, loop_computed(gain, frequency))


def margin_simulated(variant: Variant, gain: float) -> tuple[float, float]:
    """The same, with the controller's response measured on the running C code around the crossover."""
    _, crossover = margin_computed(variant, gain)
    frequency = crossover * np.array([0.8, 0.95, 1.05, 1.25])
    keep, back = math.exp(-TS / LAG), np.exp(-1j * frequency * TS)
    plant = gain * (1 - keep) * back / (1 - keep * back) * back ** round(DELAY / TS)
    # one sample between measurement and output is in the C code's answer already
    controller = np.array([controller_measured(variant, float(w)) for w in frequency])
    return phase_margin(frequency, controller * plant)


# ---- contact-tip-to-work distance


@dataclass(frozen=True)
class Regime:
    """A burning arc. The gain of the plant falls with the current (after Ayrton, volts per mm are b + d/I);
    `error`: true gain over what that law says; `lift`: jump of the distance, mm."""

    current: float
    error: float = 1.0
    lift: float = 3.0

    @property
    def gain(self) -> float:
        """V of arc per V of source, nominal 1 at 120 A."""
        return self.error * (0.03 + 116.4 / self.current)

    @property
    def wire(self) -> float:
        """mm/s that burn off at this current and 15 mm."""
        return 110.0 * (self.current / 140.0) ** (1 / 0.65)


FIELD = 0.8  # V per mm of arc
FALL = 7.0  # A per V of arc voltage
STICK_OUT = 0.024  # share of current lost per mm of wire


def distance_step(variant: Variant, regime: Regime, seconds: float = 0.3) -> np.ndarray:
    """Current (A) less its final value after the torch jumped up by `lift` at time 0."""
    variant.start()
    plant, rows, before = Plant(regime.gain), [], 6000
    for k in range(before + round(seconds / TS)):
        lift = regime.lift if k >= before else 0.0
        error = plant.change + FIELD * lift
        settled = regime.current * (1 - STICK_OUT * lift)
        plant.advance(step(SETPOINT, SETPOINT + error, settled - FALL * error, regime.wire))
        rows.append(-FALL * error)
    return np.array(rows[before:])


def reaction(response: np.ndarray, regime: Regime) -> float:
    """s until the current stays within REACTED of its jump."""
    jump = FALL * FIELD * regime.lift
    outside = np.flatnonzero(~(np.abs(response) <= REACTED * jump))
    return float(outside[-1] + 1) * TS if len(outside) else 0.0


def current_overshoot(response: np.ndarray, regime: Regime) -> float:
    """Share of the jump by which the current rises above its final value."""
    return max(0.0, float(response.max())) / (FALL * FIELD * regime.lift)
