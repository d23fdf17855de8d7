"""The process control on the laboratory's machine, and the true values that it is to hold."""

from __future__ import annotations

from array import array

import numpy as np

from waam_adapt.process_control.control import ProcessControl, Sample
from waam_adapt.process_control.params import ProcessControlParams
from waam_bridge import overrides
from waam_bridge.frames import ARC_ESTABLISHED, Telemetry
from waam_process.plant_port import SAMPLE
from waam_sim.arc import CURRENT_NOW, LIT, VOLTAGE_NOW
from waam_sim.plant import Plant

from .machine import Machine

STRUCK = 1.5  # s after a strike from which on the process is judged
BEFORE = 30  # exchanges in which the path must be straight and no slower than SLOWER: corners are not judged
SLOWER = 0.6
STRAIGHT = 0.99  # cosine
COLUMNS = 7  # layer, way along x and y in m, s, A, V, width of the pool in m
TABLE_X, TABLE_Y = ((SAMPLE.names or ()).index(n) for n in ('table_x', 'table_y'))
POOL = 50  # exchanges: in 0.5 s the pool travels its own length, and what is shorter averages out in it


class LabControl:
    """Telemetry in, factors to the bridge: what node process_control does. Does nothing while it is off."""

    def __init__(self, params: ProcessControlParams, machine: Machine) -> None:
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
        self.layer = 0  # that is laid, 0 = none
        self._arcs: list[array[float]] = []  # of every exchange COLUMNS figures
        self._lit = False

    def on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        """samples (n,) of waam_process.plant_port.SAMPLE that the plant has just lived through."""
        arc = plant.arc
        lit = arc.value(LIT) > 0.0
        if lit:
            if not self._lit:
                self._arcs.append(array('d'))
            first, last = samples.item(0), samples.item(-1)
            self._arcs[-1].extend(
                (
                    self.layer,
                    last[TABLE_X] - first[TABLE_X],
                    last[TABLE_Y] - first[TABLE_Y],
                    1e-3 * (len(samples) - 1),
                    arc.value(CURRENT_NOW),
                    arc.value(VOLTAGE_NOW),
                    plant.metal.state['width'].item(),
                )
            )
        self._lit = lit

    def _steady(self) -> list[np.ndarray]:
        """Runs of steady travel, (n, 5): layer, A, V, travel speed m/s, width of the pool m."""
        return [r for arc in self._arcs for r in _steady_runs(np.reshape(arc, (-1, COLUMNS)))]

    def values(self, mean_over: int = 1) -> dict[str, np.ndarray]:
        """(n,) of every value that may be held (A, W, J/m), as means over so many exchanges in a row."""
        blocks = [
            np.reshape(run[: len(run) // mean_over * mean_over, 1:4], (-1, mean_over, 3)).mean(
                axis=1
            )
            for run in self._steady()
            if len(run) >= mean_over
        ]
        current, voltage, speed = np.concatenate([np.empty((0, 3)), *blocks]).T
        power = current * voltage
        return {'current': current, 'power': power, 'heat_input': power / speed}

    @property
    def widths(self) -> dict[int, float]:
        """Mean width of the pool in m of every layer that has steady travel."""
        rows = np.concatenate([np.empty((0, 5)), *self._steady()])
        layers = rows[:, 0]
        return {int(n): float(rows[layers == n, 4].mean()) for n in np.unique(layers) if n}

    def variance(self) -> dict[str, float]:
        """Of every value over the square of its mean; NaN when nothing is judged."""
        found = self.values(POOL)
        return {
            name: float(np.var(v) / np.mean(v) ** 2) if len(v) > 1 else float('nan')
            for name, v in found.items()
        }


def _steady_runs(arc: np.ndarray) -> list[np.ndarray]:
    """Of one arc (n, COLUMNS): the runs of exchanges before which the path has been straight and hardly slower for
    BEFORE exchanges, as of `ProcessTrace._steady`."""
    if len(arc) <= STRUCK / 1e-2:
        return []
    way = arc[:, 1:3] / arc[:, 3:4]
    speeds = np.hypot(*way.T)
    straight, slowest, fastest = np.ones(len(way), bool), speeds.copy(), speeds.copy()
    for back in range(1, BEFORE):
        earlier = speeds[:-back]
        along = (way[back:] * way[:-back]).sum(axis=1)
        straight[back:] &= along >= STRAIGHT * speeds[back:] * earlier
        np.minimum(slowest[back:], earlier, out=slowest[back:])
        np.maximum(fastest[back:], earlier, out=fastest[back:])
    steady = straight & (slowest > np.maximum(SLOWER * fastest, 1e-3))
    steady[: round(STRUCK / 1e-2)] = False
    rows = np.column_stack((arc[:, 0], arc[:, 4:6], speeds, arc[:, 6]))
    edges = np.flatnonzero(np.diff(steady.astype(int), prepend=0, append=0))
    return [rows[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]
