"""The controller's input shaper (its real C code, through the library waam_shaper_loop) on motions of our own.

Used by test_shaper.py. Times s, frequencies Hz, positions in steps unless said otherwise.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache

import loop_library
import numpy as np

TYPES = ('none', 'zv', 'zvd', 'mzv', 'ei', '2hump_ei', '3hump_ei')
TICK = 1e-3  # s
LEAD = 0.050  # s, of the wire: the greatest mean delay that the controller takes
IMPULSES, TAPS = 5, 10
ONE = 1 << 30


class Figures(ctypes.Structure):
    """What a shaper does: ticks to the end, mean delay, moments of a corner."""

    _fields_ = [
        ('span', ctypes.c_uint32),
        ('delay', ctypes.c_float),
        ('corner', ctypes.c_float),
        ('corner2', ctypes.c_float),
    ]


@dataclass(frozen=True)
class Axis:
    """Settings of one axis."""

    type: str = 'none'
    hz: float = 50.0
    damping: float = 0.1


@cache
def library() -> ctypes.CDLL:
    lib = loop_library.load('shaper_loop')
    lib.shaper_loop_set.argtypes = [ctypes.c_char_p, ctypes.c_double]
    lib.shaper_loop_set.restype = lib.shaper_loop_tune.restype = ctypes.c_char_p
    lib.shaper_loop_tune.argtypes = [ctypes.c_float, ctypes.c_float, ctypes.POINTER(Figures)]
    lib.shaper_loop_settled.restype = ctypes.c_bool
    return lib


def start(x: Axis | None = None, y: Axis | None = None, most: float = LEAD) -> Figures:
    """Settings in force, the machine at rest at 0; ValueError says what is refused."""
    lib, figures = library(), Figures()
    lib.shaper_loop_start()
    for name, axis in (('x', x or Axis()), ('y', y or Axis())):
        settings = {'_hz': axis.hz, '_damping': axis.damping, '': TYPES.index(axis.type)}
        for end, value in settings.items():
            if wrong := lib.shaper_loop_set(f'shape_{name}{end}'.encode(), value):
                raise ValueError(f'shape_{name}{end}: {wrong.decode()}')
    if wrong := lib.shaper_loop_tune(TICK, most, figures):
        raise ValueError(wrong.decode())
    return figures


def impulses(axis: Axis) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes and times (s) of the shaper in continuous time; the settings in force are others afterwards."""
    lib = library()
    lib.shaper_loop_start()
    for name, value in (('_hz', axis.hz), ('_damping', axis.damping), ('', TYPES.index(axis.type))):
        if wrong := lib.shaper_loop_set(f'shape_x{name}'.encode(), value):
            raise ValueError(f'shape_x{name}: {wrong.decode()}')
    amplitude, time = (ctypes.c_float * IMPULSES)(), (ctypes.c_float * IMPULSES)()
    n = lib.shaper_loop_impulses(0, amplitude, time)
    return np.array(amplitude[:n], float), np.array(time[:n], float)


def taps(channel: int) -> tuple[np.ndarray, np.ndarray]:
    """Ticks ago and weights (shares of ONE) of a channel of the shaper in force: X, Y, Z, path speed."""
    ago, weight = (ctypes.c_uint32 * TAPS)(), (ctypes.c_int32 * TAPS)()
    n = library().shaper_loop_taps(channel, ago, weight)
    return np.array(ago[:n], int), np.array(weight[:n], int)


def run(planned: np.ndarray) -> np.ndarray:
    """Shaped steps (n, 3) for planned ones (n, 3), one row per tick."""
    planned = np.ascontiguousarray(planned, np.int32)
    out = np.empty_like(planned)
    pointer = ctypes.POINTER(ctypes.c_int32)
    library().shaper_loop_run(
        planned.ctypes.data_as(pointer), len(planned), out.ctypes.data_as(pointer)
    )
    return out


def settled() -> bool:
    """Nothing of the past is under way."""
    return bool(library().shaper_loop_settled())


def residual(ago_s: np.ndarray, weight: np.ndarray, hz: float, damping: float) -> float:
    """Residual vibration of a mode after these impulses, as a share of that after a single one of their sum at the end.

    V = e^(-z w t_n) |sum A_i e^(z w t_i) e^(j wd t_i)| / sum A_i (Singer and Seering).
    """
    omega = 2 * np.pi * hz
    pole = damping * omega + 1j * omega * np.sqrt(1 - damping**2)
    phasor = np.sum(weight * np.exp(pole * (np.asarray(ago_s) - np.max(ago_s))))
    return float(np.abs(phasor) / np.sum(weight))
