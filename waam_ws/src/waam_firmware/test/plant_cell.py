"""A small cell at the plant port: answers every step as it is told to.

It is written from waam_firmware/doc/plant_port.md alone and shares nothing with `waam_process.plant_port`, which the
simulated cell reads: two readings of one document, so that the tests notice when the document and the controller part.
test/test_plant_port.py allows this second layout and no other.
"""

from __future__ import annotations

import math
import socket
import struct
import threading
from dataclasses import dataclass, field
from pathlib import Path

HEADER, SAMPLE, ANSWER = struct.Struct('<IIQ'), struct.Struct('<5dI4x'), struct.Struct('<II4d2I')
ESTOP, GAS_OK, LIMIT, CONTACT, HOT, DRIVE = 1, 2, 4, 8, 16, 32
ACCELEROMETER, SHAKEN = 64, 32  # bit of the inputs; samples of a step
COUNT = 9.80665 / 256  # m/s^2, of an ADXL345
BURN_BACK_S = 0.13  # that the arc needs to climb to the contact tip
RIPPLE = 0.02  # A and V; a real arc never reads the same twice


@dataclass
class Cell:
    """Answers every step; `current`, `wire`, `voltage`, `drop` and the flags can be changed while it runs."""

    path: Path
    current: float = 180.0
    wire: float | None = None  # m/s; None = as commanded
    coast: float | None = (
        None  # s: the wire ends; the wheel runs down, and after BURN_BACK_S there is no arc
    )
    ended_s: float = 0.0  # since then
    voltage: float | None = None  # V while the arc burns; None = as set, less `drop`
    drop: float = 0.0  # V
    shorted: bool = False  # the wire is in the pool until the source goes off
    freed_by_pulse: bool = False  # the wire comes off the work once the source went on and off
    arcs: int = 0
    lit: bool = False  # source on at the last step
    dips: bool = False  # short circuits of 20 ms, ten a second
    ripple: float = RIPPLE
    flags: int = 0
    gas: bool = True
    stray: bool = False  # current although the source is off
    magic: int = 0x57414D41
    answering: bool = True
    measures: bool = False  # a distance sensor with a reading per step
    distance: float = 100.0  # mm
    shaken: int = 0  # samples of the accelerometer given so far: x rises by 2 counts with each
    steps: list[tuple[int, list[tuple]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(self.path))
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def _receive(self, size: int) -> bytes:
        data = b''
        while len(data) < size:
            part = self.socket.recv(size - len(data))
            if not part:
                raise ConnectionError
            data += part
        return data

    def _serve(self) -> None:
        try:
            while True:
                magic, count, t_us = HEADER.unpack(self._receive(16))
                assert (magic, count) == (0x57414D53, 10)
                samples = list(SAMPLE.iter_unpack(self._receive(48 * count)))
                self.steps.append((t_us, samples))
                self._react(bool(samples[-1][5] & 1))
                if self.answering:
                    self.socket.sendall(self._answer(samples[-1]))
        except OSError:
            pass

    def _react(self, on: bool) -> None:
        """Faults that the controller's own answer ends, so that no test has to be quick enough."""
        if self.shorted and self.lit and not on:
            self.shorted, self.voltage = False, None
        if self.freed_by_pulse and self.lit and not on and self.flags & CONTACT:
            self.arcs += 1
            if self.arcs == 2:  # the bead, and the pulse
                self.flags &= ~CONTACT
        self.lit = on
        if self.coast is not None:
            full, self.ended_s = 5 / 60, self.ended_s + 0.01
            self.wire = full * math.exp(-self.ended_s / self.coast)
            self.current = 0.0 if self.ended_s > BURN_BACK_S else self.current

    def thread_wire(self) -> None:
        """A new spool."""
        self.coast, self.ended_s, self.wire, self.current = None, 0.0, None, 180.0

    def _answer(self, last: tuple) -> bytes:
        *_, wire, voltage, outputs = last
        burns = bool(outputs & 1) and self.current > 0
        flags = self.flags | (GAS_OK if outputs & 2 and self.gas else 0)
        swing = self.ripple * (-1) ** len(self.steps)
        arc = (voltage - self.drop if self.voltage is None else self.voltage) + swing
        if self.dips and len(self.steps) % 10 < 2:
            arc = 3.5
        felt = self._feel() if outputs & 4 and flags & ACCELEROMETER else b''
        head = ANSWER.pack(
            self.magic,
            flags,
            self.current + swing if burns or self.stray else 0.0,
            arc if burns else 0.0,
            wire if self.wire is None else self.wire,
            self.distance,
            len(self.steps) if self.measures else 0,
            len(felt) // 12,
        )
        return head + felt

    def _feel(self) -> bytes:
        first, self.shaken = self.shaken, self.shaken + SHAKEN
        return b''.join(
            struct.pack('<3f', 2 * (k % 2000) * COUNT, -4000 * COUNT, 256 * COUNT)
            for k in range(first, self.shaken)
        )

    def close(self) -> None:
        self.socket.close()
        self.thread.join(2)
