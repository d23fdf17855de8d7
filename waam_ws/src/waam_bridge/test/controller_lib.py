"""The real controller core in this process (libwaam_controller_lib of waam_firmware): bytes in, bytes out, and time as
fast as the caller asks."""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from pathlib import Path

from ament_index_python.packages import get_package_prefix

TX_BYTES, DONE_MOST, AXES = 256 * 1024, 4096, 3
MOVE = 0  # waam_block_kind_t


class Done(ctypes.Structure):
    """A block that was executed to its end."""

    _fields_ = (
        ('line', ctypes.c_uint32),
        ('kind', ctypes.c_int32),
        ('end', ctypes.c_int32 * AXES),
        ('wire_mm_s', ctypes.c_float),
        ('voltage_v', ctypes.c_float),
    )


class View(ctypes.Structure):
    """What a look from outside shows; times in us of the controller's clock."""

    _fields_ = (
        ('now_us', ctypes.c_uint64),
        ('arc_off_us', ctypes.c_uint64),
        ('arc_off_lease_us', ctypes.c_uint64),
        *((name, ctypes.c_int32) for name in ('state', 'fault', 'arc', 'homed', 'queued')),
    )


@dataclass(frozen=True)
class Move:
    """An executed move: its line number, where it ended (steps), the wire speed (mm/s) that was in force."""

    line: int
    end: tuple[int, ...]
    wire_mm_s: float


def _library() -> ctypes.CDLL:
    """The installed library, or the one beside the controller that WAAM_VIRTUAL_CONTROLLER names."""
    other = os.environ.get('WAAM_VIRTUAL_CONTROLLER')
    path = Path(other).parent if other else Path(get_package_prefix('waam_firmware')) / 'lib'
    lib = ctypes.CDLL(str(path / 'libwaam_controller_lib.so'))
    lib.controller_lib_new.restype = ctypes.c_void_p
    lib.controller_lib_new.argtypes = (ctypes.c_uint32, ctypes.c_uint64)
    lib.controller_lib_free.argtypes = lib.controller_lib_hang_up.argtypes = (ctypes.c_void_p,)
    lib.controller_lib_rx.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t)
    lib.controller_lib_run.argtypes = (ctypes.c_void_p, ctypes.c_uint32)
    for call in (lib.controller_lib_take, lib.controller_lib_executed):
        call.restype = ctypes.c_size_t
        call.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)
    lib.controller_lib_look.argtypes = (ctypes.c_void_p, ctypes.POINTER(View))
    return lib


class ControllerLib:
    """One controller with a plant that does nothing wrong."""

    def __init__(self, boot: int = 1, start_us: int = 1_000_000) -> None:
        self._lib = _library()
        self._handle = self._lib.controller_lib_new(boot, start_us)
        self._bytes = ctypes.create_string_buffer(TX_BYTES)
        self._done = (Done * DONE_MOST)()
        self._view = View()

    def close(self) -> None:
        self._lib.controller_lib_free(self._handle)

    def feed(self, data: bytes) -> None:
        self._lib.controller_lib_rx(self._handle, data, len(data))

    def hang_up(self) -> None:
        self._lib.controller_lib_hang_up(self._handle)

    def run(self, milliseconds: int) -> None:
        self._lib.controller_lib_run(self._handle, milliseconds)

    def take(self) -> bytes:
        count = self._lib.controller_lib_take(self._handle, self._bytes, TX_BYTES)
        return ctypes.string_at(self._bytes, count)

    def moves(self) -> list[Move]:
        """Moves that were executed since the last call."""
        count = self._lib.controller_lib_executed(self._handle, self._done, DONE_MOST)
        done = self._done[:count]
        return [Move(d.line, tuple(d.end), d.wire_mm_s) for d in done if d.kind == MOVE]

    def look(self) -> View:
        self._lib.controller_lib_look(self._handle, ctypes.byref(self._view))
        return self._view
