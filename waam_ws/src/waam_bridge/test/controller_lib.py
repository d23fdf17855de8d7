"""The real controller core in this process with a plant that does nothing wrong, and what it has executed."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

from waam_bridge.embedded import Controller

DONE_MOST, AXES = 4096, 3
MOVE = 0  # waam_block_kind_t


class Done(ctypes.Structure):
    """A block that was executed to its end (controller_lib_done_t)."""

    _fields_ = (
        ('line', ctypes.c_uint32),
        ('kind', ctypes.c_int32),
        ('end', ctypes.c_int32 * AXES),
        ('wire_mm_s', ctypes.c_float),
        ('voltage_v', ctypes.c_float),
    )


class Move(NamedTuple):
    """An executed move: its line number, where it ended (steps), the wire speed (mm/s) that was in force."""

    line: int
    end: tuple[int, ...]
    wire_mm_s: float


class ControllerLib(Controller):
    """In IDLE; time goes on by `run`."""

    new = 'controller_lib_new'

    def __init__(self, boot: int = 1, start_us: int = 1_000_000) -> None:
        super().__init__(start_us, boot)
        self._done = (Done * DONE_MOST)()
        handle = ctypes.c_void_p
        self._lib.controller_lib_run.argtypes = (handle, ctypes.c_uint32)
        self._lib.controller_lib_executed.restype = ctypes.c_size_t
        self._lib.controller_lib_executed.argtypes = (handle, handle, ctypes.c_size_t)

    def run(self, milliseconds: int) -> None:
        self._lib.controller_lib_run(self._handle, milliseconds)

    def moves(self) -> list[Move]:
        """Moves that were executed since the last call."""
        count = self._lib.controller_lib_executed(self._handle, self._done, DONE_MOST)
        done = self._done[:count]
        return [Move(d.line, tuple(d.end), d.wire_mm_s) for d in done if d.kind == MOVE]
