"""The controller's accelerometer, as this end sees it: switched on and off, its lines gathered into batches. Pure.

The sensor has an oscillator of its own, so its rate is measured by the controller's clock. A line that is missing, or
samples that the controller says were lost, leave a gap in the numbers of the batches.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import frames, requests
from .machine import Machine
from .mounting import mounting
from .outbox import WARNING, Batch
from .pending import Reply

CAPABILITY = 'ACCEL'
SENSOR = 'adxl345'
NOMINAL_RATE = 3200.0  # 1/s, by its data sheet
PER_COUNT = 9.80665 / 256  # m/s^2, full resolution
RANGE = 16 * 9.80665  # m/s^2
BATCH = 320  # samples: 0.1 s
MEASURED_FROM = 1600  # samples after which the measured rate counts
BEGIN_LIMIT = 1.0  # s until the first line must be there


class Accelerometer:
    """Of one bridge. Nothing is asked of a controller that does not name it among its capabilities."""

    def __init__(self, axes: str) -> None:
        self._turn = mounting(axes)
        self._sequence = 0
        self._parts: list[np.ndarray] = []
        self._t_us = 0
        self._rate = NOMINAL_RATE
        self._last: frames.Acceleration | None = None
        self._origin_us = 0  # where the rate is measured from,
        self._samples = 0  # and samples since then
        self._sick = ''  # what the controller has said since it was switched on
        self._waits: tuple[Reply, float] | None = None  # for the first line

    def switch(self, machine: Machine, on: bool, reply: Reply, now: float) -> None:
        """Replies once samples come, or with what is wrong; switched off, once the controller has said so."""
        if not machine.connected:
            reply(requests.NOT_CONNECTED, machine.message)
            return
        if CAPABILITY not in machine.link.who.capabilities:
            reply(requests.WRONG_STATE, 'the controller has no accelerometer')
            return

        def done(code: int, text: str) -> None:
            if code != requests.OK or not on:
                self._answer(machine, reply, code, text)
            elif self._sick:
                self._answer(machine, reply, requests.REFUSED, self._sick)
            else:
                self._waits = reply, now + BEGIN_LIMIT

        self._end_wait(machine, requests.WRONG_STATE, 'switched again')
        self._restart()
        self._sick = ''
        machine.link.ask('M', '1' if on else '0', done, now)

    @staticmethod
    def _answer(machine: Machine, reply: Reply, code: int, text: str) -> None:
        replies: list[Callable[[], None]] = machine.outbox.replies
        replies.append(lambda: reply(code, text))

    def _end_wait(self, machine: Machine, code: int, text: str) -> None:
        if self._waits:
            reply, _ = self._waits
            self._waits = None
            self._answer(machine, reply, code, text)

    def _restart(self) -> None:
        self._parts, self._last = [], None
        self._samples, self._rate = 0, NOMINAL_RATE

    def poll(self, machine: Machine, now: float) -> None:
        """now: s, steady clock."""
        if self._waits and now > self._waits[1]:
            self._end_wait(machine, requests.TIMEOUT, 'no samples of the accelerometer within 1 s')

    def lost(self, machine: Machine, text: str) -> None:
        """The controller says that no samples come any more."""
        self._sick = text
        machine.notice(WARNING, 'node', text)
        self._end_wait(machine, requests.REFUSED, text)

    def heard(self, machine: Machine, line: frames.Acceleration) -> None:
        """Takes a line; batches that are full go to the outbox."""
        self._end_wait(machine, requests.OK, 'accelerometer on')
        last = self._last
        if last is not None and (line.seq != last.seq + 1 or line.lost != last.lost):
            self._flush(machine)
            self._sequence += 1
            self._samples = 0
        if self._samples == 0:
            self._origin_us = line.t_us
        elif self._samples >= MEASURED_FROM and line.t_us > self._origin_us:
            self._rate = self._samples / (line.t_us - self._origin_us) * 1e6
        if not self._parts:
            self._t_us = line.t_us
        self._last = line
        self._samples += len(line.counts)
        self._parts.append(line.counts)
        if sum(map(len, self._parts)) >= BATCH:
            self._flush(machine)

    def _flush(self, machine: Machine) -> None:
        if not self._parts:
            return
        values = np.concatenate(self._parts) * PER_COUNT @ self._turn.T
        machine.outbox.accelerations.append(Batch(self._sequence, self._t_us, self._rate, values))
        self._sequence, self._parts = self._sequence + 1, []
