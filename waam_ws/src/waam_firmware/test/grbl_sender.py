"""A GRBL sender in this process (libwaam_controller_lib): bytes in, lines out, in ticks of 1 ms."""

from __future__ import annotations

import ctypes
import re
from typing import Any

import numpy as np
from shaper_machine import library, sealed, steps

from waam_process.plant_port import SAMPLE

RESET, JOG_CANCEL = b'\x18', b'\x85'
ANSWER = re.compile(r'ok|error:\d+')
STATUS = re.compile(
    r'<(?P<state>[A-Za-z]+(:[01])?)\|MPos:(?P<at>-?\d+\.\d{3},-?\d+\.\d{3},-?\d+\.\d{3})\|FS:(?P<feed>\d+),0'
    r'(\|Pn:(?P<pins>[XYZ]+))?\|WCO:(?P<zero>-?\d+\.\d{3},-?\d+\.\d{3},-?\d+\.\d{3})\|Ov:(?P<override>\d+),100,100>'
)


class View(ctypes.Structure):
    """controller_lib_view_t."""

    _fields_ = [
        *((name, ctypes.c_uint64) for name in ('now_us', 'arc_off_us', 'arc_off_lease_us')),
        *((name, ctypes.c_int32) for name in ('state', 'fault', 'arc', 'homed', 'queued')),
    ]


class Sender:
    """Speaks to a controller beside the home switches that has not said who it is; `alarm`: as after power-up; `copy`:
    to a copy of that one's controller."""

    def __init__(self, alarm: bool = False, copy: Sender | None = None) -> None:
        lib = self.lib = library()
        handle = ctypes.c_void_p
        lib.controller_lib_with_cell.restype = handle
        lib.controller_lib_with_cell.argtypes = (ctypes.c_uint32, ctypes.c_uint64)
        lib.controller_lib_copy.argtypes = (handle, handle)
        lib.controller_lib_place.argtypes = (handle, *[ctypes.c_double] * 3)
        lib.controller_lib_hang_up.argtypes = (handle,)
        lib.controller_lib_look.argtypes = (handle, handle)
        lib.controller_lib_answer.argtypes = (handle, ctypes.c_uint32, *[ctypes.c_double] * 3)
        new = lib.controller_lib_with_cell if alarm else lib.controller_lib_new
        self.handle = new(1, 1_000_000)
        lib.controller_lib_place(self.handle, 0.3, 0.3, 199.7)
        if copy:
            lib.controller_lib_copy(self.handle, copy.handle)
        self.lines: list[str] = []
        self.arc_was_on = False
        self._bytes = ctypes.create_string_buffer(256 * 1024)
        self._text = ''

    def close(self) -> None:
        self.lib.controller_lib_free(self.handle)

    def send(self, data: bytes) -> None:
        self.lib.controller_lib_rx(self.handle, data, len(data))
        self._read()

    def _read(self) -> None:
        count = self.lib.controller_lib_take(self.handle, self._bytes, len(self._bytes))
        *whole, self._text = (self._text + self._bytes[:count].decode()).split('\n')
        self.lines += [line.rstrip('\r') for line in whole]

    def tick(self, ms: int = 1) -> np.ndarray:
        """Positions (ms, 3) in steps."""
        out = np.zeros(ms, SAMPLE)
        self.lib.controller_lib_step(self.handle, ms, out.ctypes.data)
        self._read()
        self.arc_was_on = self.arc_was_on or bool(self.look().arc)
        return steps(out)

    def look(self) -> View:
        view = View()
        self.lib.controller_lib_look(self.handle, ctypes.byref(view))
        return view

    def until(self, condition, most: int = 60_000) -> None:
        for _ in range(most):
            if condition():
                return
            self.tick()
        raise AssertionError(f'not within {most} ms: {self.lines[-5:]}')

    def ask(self, line: str) -> list[str]:
        """What comes up to and with the answer to one line."""
        start = len(self.lines)
        self.send(line.encode() + b'\n')
        self.until(lambda: any(ANSWER.fullmatch(x) for x in self.lines[start:]))
        assert ANSWER.fullmatch(self.lines[-1])
        return self.lines[start:]

    def run(self, *lines: str) -> None:
        """Each is taken; until the machine is idle."""
        for line in lines:
            assert self.ask(line) == ['ok'], (line, self.lines[-3:])
        self.until(lambda: self.status()['state'] == 'Idle')

    def status(self) -> dict[str, Any]:
        """Of the newest report, asked for now; lengths in mm, feed in mm/min."""
        start = len(self.lines)
        self.send(b'?')
        self.until(lambda: any(x.startswith('<') for x in self.lines[start:]), 20)
        found = STATUS.fullmatch(next(x for x in self.lines[start:] if x.startswith('<')))
        assert found, self.lines[-1]
        values = found.groupdict()
        for name in ('at', 'zero'):
            values[name] = [float(v) for v in values[name].split(',')]
        return values | {'feed': int(values['feed']), 'override': int(values['override'])}

    def inputs(self, bits: int) -> None:
        """Of the cell, as of the plant port: 1 emergency stop."""
        self.lib.controller_lib_answer(self.handle, bits, 0.0, 0.0, 0.0)

    def native(self, line: str) -> None:
        self.send(sealed(line))

    def hang_up(self) -> None:
        self.lib.controller_lib_hang_up(self.handle)
