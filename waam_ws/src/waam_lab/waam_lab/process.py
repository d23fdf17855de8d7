"""The process control on the laboratory's machine, and the true values that it is to hold."""

from __future__ import annotations

import numpy as np

from waam_adapt.hold.control import ProcessControl, Sample
from waam_adapt.hold.params import HoldParams
from waam_bridge import overrides
from waam_bridge.frames import ARC_ESTABLISHED, Telemetry
from waam_sim.plant import Plant

from .machine import Machine

STRUCK = 1.5  # s after a strike from which on the process is judged
BEFORE = 30  # exchanges in which the path must be straight and no slower than SLOWER: corners are not judged
SLOWER = 0.6
STRAIGHT = 0.99  # cosine
POOL = 50  # exchanges: in 0.5 s the pool travels its own length, and what is shorter averages out in it


class LabControl:
    """Telemetry in, factors to the bridge: what node process_control does. Does nothing while it is off."""

    def __init__(self, params: HoldParams, machine: Machine) -> None:
        self._machine = machine
        self.control = ProcessControl(params) if params.value != 'none' else None

    def on_frame(self, t: Telemetry) -> None:
        """One telemetry frame."""
        if self.control is None:
            return
        factors = self.control.add(
            Sample(
                t.t_us * 1e-6,
                t.current_ma * 1e-3,
                t.voltage_mv * 1e-3,
                t.v_um_s * 1e-6,
                t.wire_cmd_um_s * 1e-6,
                t.flags & ARC_ESTABLISHED != 0,
                t.speed_permille * 1e-3,
                t.wire_permille * 1e-3,
            )
        )
        if factors is not None:
            now = self._machine.now
            overrides.process(
                self._machine.bridge, factors.speed, factors.wire, 'process_control', now
            )


class ProcessTrace:
    """Listens to a cell of the laboratory: the truth of every exchange (10 ms) in the steady parts of beads."""

    def __init__(self) -> None:
        self.runs: list[
            list[tuple[float, float, float]]
        ] = []  # current A, voltage V, travel speed m/s
        self.layer = 0  # that is laid, 0 = none
        self._widths: dict[int, list[float]] = {}  # m, of the pool, by layer
        self._ways: list[np.ndarray] = []  # m/s, since the strike
        self._steady = False

    def on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        """samples (n,) of waam_process.plant_port.SAMPLE that the plant has just lived through."""
        arc = plant.arc.state[0]
        if not arc['lit'] > 0.0:
            self._ways.clear()
            self._steady = False
            return
        way = np.array(
            [samples[axis][-1] - samples[axis][0] for axis in ('table_x', 'table_y')], float
        )
        self._ways.append(way / (1e-3 * (len(samples) - 1)))
        recent = np.array(self._ways[-BEFORE:])
        speeds = np.hypot(*recent.T)
        speed = float(speeds[-1])
        along = recent @ recent[-1]
        straight = bool(np.all(along >= STRAIGHT * speeds * speed))
        steady = straight and speeds.min() > max(SLOWER * speeds.max(), 1e-3)
        steady = steady and len(self._ways) > STRUCK / 1e-2
        if steady:
            if not self._steady:
                self.runs.append([])
            self.runs[-1].append((float(arc['current']), float(arc['voltage']), speed))
            self._widths.setdefault(self.layer, []).append(float(plant.metal.state['width'][0]))
        self._steady = steady

    def values(self, mean_over: int = 1) -> dict[str, np.ndarray]:
        """(n,) of every value that may be held (A, W, J/m), as means over so many exchanges in a row."""
        blocks = [
            np.reshape(run[: len(run) // mean_over * mean_over], (-1, mean_over, 3)).mean(axis=1)
            for run in self.runs
            if len(run) >= mean_over
        ]
        current, voltage, speed = np.concatenate([np.empty((0, 3)), *blocks]).T
        power = current * voltage
        return {'current': current, 'power': power, 'heat_input': power / speed}

    @property
    def widths(self) -> dict[int, float]:
        """Mean width of the pool in m of every layer that has steady travel."""
        return {layer: float(np.mean(w)) for layer, w in self._widths.items() if layer}

    def variance(self, mean_over: int = POOL) -> dict[str, float]:
        """Of every value over the square of its mean; NaN when nothing is judged."""
        found = self.values(mean_over)
        return {
            name: float(np.var(v) / np.mean(v) ** 2) if len(v) > 1 else float('nan')
            for name, v in found.items()
        }
