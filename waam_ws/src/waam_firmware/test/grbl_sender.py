"""A GRBL sender in this process (libwaam_controller_lib): bytes in, lines out, in ticks of 1 ms."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
from shaper_machine import Inert, sealed, steps

from waam_bridge.embedded import Controller
from waam_process.plant_port import SAMPLE

RESET, JOG_CANCEL = b'\x18', b'\x85'
ANSWER = re.compile(r'ok|error:\d+')
STATUS = re.compile(
    r'<(?P<state>[A-Za-z]+(:[01])?)\|MPos:(?P<at>-?\d+\.\d{3},-?\d+\.\d{3},-?\d+\.\d{3})\|FS:(?P<feed>\d+),0'
    r'(\|Pn:(?P<pins>[XYZ]+))?\|WCO:(?P<zero>-?\d+\.\d{3},-?\d+\.\d{3},-?\d+\.\d{3})\|Ov:(?P<override>\d+),100,100>'
)


class Sender:
    """Speaks to a controller beside the home switches that has not said who it is; `alarm`: as after power-up; `copy`:
    to a copy of that one's controller."""

    def __init__(self, alarm: bool = False, copy: Sender | None = None) -> None:
        self.core = Controller(1_000_000) if alarm else Inert(1_000_000)
        self.core.place(0.3e-3, 0.3e-3, 199.7e-3)
        if copy:
            self.core.copy(copy.core)
        self.look = self.core.look
        self.lines: list[str] = []
        self.arc_was_on = False
        self._text = ''

    def close(self) -> None:
        self.core.close()

    def send(self, data: bytes) -> None:
        self.core.feed(data)
        self._read()

    def _read(self) -> None:
        *whole, self._text = (self._text + self.core.take().decode()).split('\n')
        self.lines += [line.rstrip('\r') for line in whole]

    def tick(self, ms: int = 1) -> np.ndarray:
        """Positions (ms, 3) in steps."""
        out = np.zeros(ms, SAMPLE)
        self.core.step(out)
        self._read()
        self.arc_was_on = self.arc_was_on or bool(self.look().arc)
        return steps(out)

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
        self.core.answer(SimpleNamespace(
            inputs=bits, current=0.0, voltage=0.0, wire_speed=0.0, distance=0.0, distance_reading=0,
        ))  # fmt: skip

    def native(self, line: str) -> None:
        self.send(sealed(line))
