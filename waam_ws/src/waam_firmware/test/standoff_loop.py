"""The controller's standoff control (its real C code, through the library waam_standoff_loop) around sensors, arcs and
metal of our own.

Used by test_standoff.py. Lengths mm, times s, currents A, voltages V, wire speed mm/s.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import loop_library
import numpy as np

STAY, APPROACH, FOLLOW, RETURN = range(4)
OFF, LASER, INFRARED, ARC = range(4)
RELAY, PID = range(2)
WELL, LOST, STUCK, NO_ANSWER, LIMIT, CONTRADICTION = range(6)
TICK = 1e-3  # s
CONTACT = 15.0  # mm, contact distance of the program


class Answer(ctypes.Structure):
    """What the control says after a millisecond."""

    _fields_ = [
        ('correction', ctypes.c_float),
        ('measured', ctypes.c_float),
        ('alarm', ctypes.c_int32),
        ('known', ctypes.c_int32),
        ('ready', ctypes.c_int32),
        ('alarms', ctypes.c_int32),
    ]


@cache
def library() -> ctypes.CDLL:
    lib = loop_library.load('standoff_loop')
    lib.standoff_loop_set.argtypes = [ctypes.c_char_p, ctypes.c_double]
    lib.standoff_loop_set.restype = lib.standoff_loop_check.restype = ctypes.c_char_p
    lib.standoff_loop_path.argtypes = [ctypes.c_int32, *(3 * [ctypes.c_float])]
    lib.standoff_loop_step.argtypes = [
        ctypes.c_uint32,
        *(4 * [ctypes.c_float]),
        ctypes.POINTER(Answer),
    ]
    lib.standoff_loop_infrared_mm.argtypes = lib.standoff_loop_pulses.argtypes = [ctypes.c_float]
    lib.standoff_loop_infrared_mm.restype = ctypes.c_float
    lib.standoff_loop_pulses.restype = ctypes.c_uint32
    return lib


def start(**settings: float) -> None:
    """Shipped settings, changed; ValueError names what is refused."""
    library().standoff_loop_start()
    for name, value in settings.items():
        if wrong := library().standoff_loop_set(name.encode(), value):
            raise ValueError(f'{name}: {wrong.decode()}')
    if wrong := library().standoff_loop_check():
        raise ValueError(f'{wrong.decode()}: does not fit the others')


def infrared_mm(counts: float) -> float:
    return library().standoff_loop_infrared_mm(counts)


def pulses(error: float) -> int:
    return library().standoff_loop_pulses(error)


# ---- the source's own trial: a step of the distance, relay, ideal drive

RELAY_OF_SOURCE = {
    'source': LASER, 'law': RELAY, 'dead_mm': 0.1, 'up_mm': 20, 'down_mm': 20, 'rate_mm_s': 20,
    'accel_mm_s2': 10000, 'window_mm': 50, 'jump_mm': 50, 'confirm_s': 0, 'answer_mm': 20, 'limit_s': 60,
    'stuck_s': 0, 'cross_mm': 0,
}  # fmt: skip
HALF_STEP = 0.01  # mm of the source's lead screw


def of_division(division: int) -> float:
    """mm per pulse: a half step is 0.01 mm."""
    return 2 * HALF_STEP / division


Sensor = Callable[[float, int], float | None]


@dataclass
class Ideal:
    """Distance as it is, once per period (ms), at its end."""

    period: int = 10

    def __call__(self, distance: float, ms: int) -> float | None:
        return distance if (ms + 1) % self.period == 0 else None


@dataclass
class Infrared:
    """The source's sensor: a cycle of 16.5 ms, counts of the converter with noise (standard deviation in counts)."""

    seed: int = 1
    noise: float = 2.0
    cycle: float = 16.5
    rng: np.random.Generator = field(init=False)
    due: float = 0.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        counts = np.arange(60, 640)
        self._counts = counts[::-1]
        self._mm = np.polyval([-5e-11, 1e-7, -8e-5, 3.24e-2, -6.84, 698.49], counts)[::-1]

    def __call__(self, distance: float, ms: int) -> float | None:
        if ms < self.due:
            return None
        self.due += self.cycle
        true = np.interp(distance, self._mm, self._counts)
        return float(np.round(true + self.noise * self.rng.standard_normal()))


def run(
    sensor: Sensor, surface: np.ndarray, known_z: bool = False, **settings: float
) -> np.ndarray:
    """True distances (mm), one per ms, over metal of these heights (mm); the program's torch is 100 mm above 0.

    known_z: the control is told its own z, as the controller does; the source's filters do not know it.
    """
    start(**settings)
    lib, answer, reading, last = library(), Answer(), 0, 100.0
    out = np.empty(len(surface))
    for ms, height in enumerate(surface):
        out[ms] = 100.0 + answer.correction - height
        value = sensor(float(out[ms]), ms)
        if value is not None:
            reading, last = reading + 1, value
        lib.standoff_loop_path(FOLLOW, 0.0 if known_z else -answer.correction, 0.0, 0.0)
        lib.standoff_loop_step(reading, last, 0.0, 0.0, 0.0, answer)
    return out


def arrival(distance: np.ndarray, band: float = 0.1) -> float:
    """s until the distance is within `band` mm of 100 for the first time."""
    inside = np.flatnonzero(np.abs(distance - 100.0) <= band + 1e-4)
    return float(inside[0]) * TICK if len(inside) else math.inf
