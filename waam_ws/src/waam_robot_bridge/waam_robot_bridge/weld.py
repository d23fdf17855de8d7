"""The welding outputs, in step with a robot that follows late: arc, gas (digital), wire and voltage (analogue). Pure.

They are handed out with every step. The device behind them has to drop the arc when none come any more (a field bus
does, by its watchdog): that is the last part of the arc lease, which holds when the bridge itself has died.
"""

from __future__ import annotations

from collections import deque

import numpy as np

ARC, GAS = 1, 2  # bits of the outputs


class Delayed:
    """Outputs of the controller, `steps` exchanges late: then the torch is where they belong to."""

    def __init__(self, steps: int) -> None:
        self._late: deque[np.ndarray] = deque(maxlen=steps + 1)

    def next(self, samples: np.ndarray, at_once: bool, cut: bool) -> None:
        """Puts the outputs that act now into samples (n,). at_once: those of this moment act, and those that waited
        are forgotten: the arc has to end. cut: no arc and no wire."""
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
