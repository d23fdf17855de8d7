"""The controller core in this process (libwaam_controller_lib of waam_firmware): bytes and sensor readings in, bytes
and outputs out, and time as fast as the caller asks."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np

from waam_process.plant_port import SAMPLE

TX_BYTES = 256 * 1024
LIBRARY = 'libwaam_controller_lib.so'


class Reading(Protocol):
    """What the inputs see: bits as of the plant port, A, V, m/s; newest reading of a distance sensor."""

    @property
    def inputs(self) -> int: ...
    @property
    def current(self) -> float: ...
    @property
    def voltage(self) -> float: ...
    @property
    def wire_speed(self) -> float: ...
    @property
    def distance(self) -> float: ...
    @property
    def distance_reading(self) -> int: ...


class View(ctypes.Structure):
    """What a look from outside shows (controller_lib_view_t)."""

    _fields_ = [
        ('now_us', ctypes.c_uint64),
        ('arc_off_us', ctypes.c_uint64),
        ('arc_off_lease_us', ctypes.c_uint64),
        ('state', ctypes.c_int32),
        ('fault', ctypes.c_int32),
        ('arc', ctypes.c_int32),
        ('homed', ctypes.c_int32),
        ('queued', ctypes.c_int32),
    ]


def _find() -> Path:
    """Beside the controller that WAAM_VIRTUAL_CONTROLLER names (another build), else in a prefix that is sourced."""
    if other := os.environ.get('WAAM_VIRTUAL_CONTROLLER'):
        return Path(other).with_name(LIBRARY)
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':'):
        candidate = Path(prefix) / 'lib' / LIBRARY
        if prefix and candidate.exists():
            return candidate
    raise OSError(
        f'{LIBRARY} of waam_firmware is not installed: is the workspace built and sourced?'
    )


@cache
def _library() -> ctypes.CDLL:
    """The installed library. OSError when the workspace is not built."""
    lib = ctypes.CDLL(str(_find()))
    handle, text, size = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t
    for new in (lib.controller_lib_new, lib.controller_lib_with_cell):
        new.restype, new.argtypes = handle, (ctypes.c_uint32, ctypes.c_uint64)
    lib.controller_lib_place.argtypes = (handle, *(3 * (ctypes.c_double,)))
    lib.controller_lib_widen.argtypes = (handle, 3 * ctypes.c_double, 3 * ctypes.c_double)
    lib.controller_lib_machine_steps.argtypes = (handle, 3 * ctypes.c_double)
    lib.controller_lib_copy.argtypes = (handle, handle)
    lib.controller_lib_free.argtypes = (handle,)
    lib.controller_lib_hang_up.argtypes = (handle,)
    lib.controller_lib_part.argtypes = (handle, ctypes.c_double)
    lib.controller_lib_rx.argtypes = (handle, text, size)
    lib.controller_lib_step.argtypes = (handle, ctypes.c_uint32, handle)
    lib.controller_lib_answer.argtypes = (handle, ctypes.c_uint32, *(3 * (ctypes.c_double,)))
    lib.controller_lib_distance.argtypes = (handle, ctypes.c_uint32, ctypes.c_double)
    lib.controller_lib_take.restype = size
    lib.controller_lib_take.argtypes = (handle, handle, size)
    lib.controller_lib_look.argtypes = (handle, ctypes.POINTER(View))
    return lib


class Controller:
    """One controller that was just switched on: in ALARM until it is reset. Its clock starts at `start_us`. new: what
    makes it; with `controller_lib_new` it is in IDLE and has a plant of its own that does nothing wrong."""

    new = 'controller_lib_with_cell'

    def __init__(self, start_us: int, boot: int = 1) -> None:
        self._lib = _library()
        self._handle = getattr(self._lib, self.new)(boot, start_us)
        self._bytes = ctypes.create_string_buffer(TX_BYTES)
        self._memory = memoryview(self._bytes).cast('B')
        self._view = View()
        # of the last step, and their address
        self._samples: tuple[np.ndarray | None, int] = (None, 0)

    def close(self) -> None:
        """Frees the core; may be called twice, nothing else may be called afterwards."""
        if self._handle:
            self._lib.controller_lib_free(self._handle)
            self._handle = None

    def place(self, x: float, y: float, z: float) -> None:
        """Says where the axes stand (m, machine coordinates) before anything has moved."""
        self._lib.controller_lib_place(self._handle, x * 1e3, y * 1e3, z * 1e3)

    def machine_steps(self, steps_per_mm: Sequence[float]) -> None:
        """Steps that a mm of the machine's axes takes, whatever the controller has, before anything has moved."""
        self._lib.controller_lib_machine_steps(self._handle, (ctypes.c_double * 3)(*steps_per_mm))

    def widen(self, low: Sequence[float], high: Sequence[float]) -> None:
        """The axes reach all that lies between low and high (m, machine coordinates), before anything has moved."""
        box = [(ctypes.c_double * 3)(*(v * 1e3 for v in corner)) for corner in (low, high)]
        self._lib.controller_lib_widen(self._handle, *box)

    def copy(self, other: Controller) -> None:
        """Becomes what the other one is now; what is run afterwards does not touch the other one."""
        self._lib.controller_lib_copy(self._handle, other._handle)

    def feed(self, data: bytes) -> None:
        """Bytes from the host."""
        self._lib.controller_lib_rx(self._handle, data, len(data))

    def step(self, samples: np.ndarray) -> None:
        """Runs len(samples) ms; samples (n,) of SAMPLE takes what the outputs did."""
        known, address = self._samples
        if samples is not known:
            if samples.dtype != SAMPLE or not samples.flags.c_contiguous:
                text = 'samples must be a contiguous array of waam_process.plant_port.SAMPLE'
                raise ValueError(text)
            address = samples.ctypes.data
            self._samples = samples, address
        self._lib.controller_lib_step(self._handle, len(samples), address)

    def answer(self, reading: Reading) -> None:
        """Sets what the inputs read from now on."""
        r = reading
        self._lib.controller_lib_answer(self._handle, r.inputs, r.current, r.voltage, r.wire_speed)
        self._lib.controller_lib_distance(self._handle, r.distance_reading, r.distance)

    def part(self, volts: float) -> None:
        """What the converter for the temperature of the part sees from now on."""
        self._lib.controller_lib_part(self._handle, volts)

    def hang_up(self) -> None:
        """The host's terminal is closed."""
        self._lib.controller_lib_hang_up(self._handle)

    def take(self) -> bytes:
        """Bytes sent to the host since the last call."""
        count = self._lib.controller_lib_take(self._handle, self._bytes, TX_BYTES)
        return self._memory[:count].tobytes()

    def look(self) -> View:
        """State, fault and outputs as they are now; the next look overwrites it."""
        self._lib.controller_lib_look(self._handle, ctypes.byref(self._view))
        return self._view
