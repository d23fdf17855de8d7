"""The welding interface: two digital and two analogue outputs, in step with the robot that follows late. Pure.

Outputs are sent with every step, and the device behind them drops the arc when none come for `watchdog` seconds: that
is the lease's last part, which holds when the bridge itself has died.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

ARC, GAS = 1, 2


@dataclass(frozen=True)
class Weld:
    """arc, gas: on; wire: m/s; voltage: V."""

    arc: bool = False
    gas: bool = False
    wire: float = 0.0
    voltage: float = 0.0


OFF = Weld()


class Delayed:
    """Outputs of the controller, `steps` exchanges late: then the torch is where they belong to."""

    def __init__(self, steps: int) -> None:
        self._late: deque[np.ndarray] = deque(maxlen=steps + 1)

    def next(self, samples: np.ndarray, at_once: bool, cut: bool) -> None:
        """Puts the outputs that act now into samples (n,). at_once: those of this moment act, and those that waited
        are forgotten, as when the arc has to end. cut: no arc and no wire."""
        outputs = samples[['wire_cmd', 'voltage_set', 'outputs']].copy()
        if at_once or not self._late:
            self._late.clear()
        self._late.append(outputs)
        old = self._late[0]
        for name in ('wire_cmd', 'voltage_set', 'outputs'):
            samples[name] = old[name]
        if cut:
            samples['outputs'] &= np.uint32(GAS)
            samples['wire_cmd'] = 0.0
