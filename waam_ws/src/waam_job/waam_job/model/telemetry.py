"""Sums and a thinned track over telemetry, for layer reports and plots. Pure; called at 100 Hz and more."""

from __future__ import annotations

import math
from array import array

import numpy as np

from waam_process.materials import CURRENT_EXPONENT

from .snapshots import Sums

COLUMNS = (
    't',
    'x',
    'y',
    'z',
    'current',
    'voltage',
    'wire_feed',
    'wire_feed_commanded',
    'speed',
    'temperature',
    'arc',
    'layer',
    'arc_changed',  # s, when the arc last struck or went out since the row before; NaN = it did not
)


class TelemetryStats:
    """Feed it every frame with `add`; `take_sums` and `take_track` hand over and start afresh."""

    def __init__(self, every: int = 10) -> None:
        self.every = every
        self.temperature = float('nan')
        self.layer = 0
        self._sums = Sums()
        self._rows = array('d')
        self._last_sequence: int | None = None
        self._last_us = 0
        self._arc_before = False
        self._changed = math.nan

    def add(self, sequence: int, controller_us: int, t: float, position: tuple[float, float, float], current: float,
            voltage: float, wire: float, wire_commanded: float, speed: float, arc: bool) -> None:  # fmt: skip
        """One frame; SI, t in s of ROS time, arc = current flows."""
        s = self._sums
        s.frames += 1
        if self._last_sequence is not None:
            gap = (sequence - self._last_sequence - 1) & 0xFFFFFFFF
            if gap < 1_000_000:
                s.lost += gap
            if gap == 0 and controller_us > self._last_us:
                s.frame_period = (controller_us - self._last_us) * 1e-6
        self._last_sequence, self._last_us = sequence, controller_us
        if arc:
            s.arc_frames += 1
            s.current += current
            s.voltage += voltage
            s.wire += wire
            s.speed += speed
            g = wire_commanded**CURRENT_EXPONENT if wire_commanded > 0 else 0.0
            s.current_sq += current * current
            s.current_feed += current * g
            s.feed_sq += g * g
            if speed > 1e-4:
                s.power_per_speed += current * voltage / speed
            s.arc_starts += not self._arc_before
        if arc != self._arc_before:
            self._changed = t
        self._arc_before = arc
        if s.frames % self.every == 0:
            self._rows.extend(
                (
                    t,
                    *position,
                    current,
                    voltage,
                    wire,
                    wire_commanded,
                    speed,
                    self.temperature,
                    arc,
                    self.layer,
                    self._changed,
                )
            )
            self._changed = math.nan

    def take_sums(self) -> Sums:
        """Sums since the last call; the period of the frames is kept."""
        taken, self._sums = self._sums, Sums(frame_period=self._sums.frame_period)
        return taken

    def take_track(self) -> dict[str, np.ndarray]:
        """Columns by name, each (n,)."""
        rows, self._rows = self._rows, array('d')
        table = np.array(rows).reshape(-1, len(COLUMNS))
        return {name: table[:, i] for i, name in enumerate(COLUMNS)} if len(table) else {}
