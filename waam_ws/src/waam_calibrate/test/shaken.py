"""A sweep on the real controller core against the simulated gantry: for tests and benchmarks."""

from __future__ import annotations

import numpy as np

from waam_bridge import commands, frames, program
from waam_bridge.params import BridgeParams
from waam_calibrate.resonance import Samples
from waam_calibrate.sweep import Sweep
from waam_lab.machine import Machine
from waam_process.segment import Kind, Segment
from waam_sim import part
from waam_sim.gantry import SENSOR_RATE, GantryParams
from waam_sim.plant import Plant, PlantParams

POINT = (0.2, 0.15, 0.1)  # m, machine


class Shaker:
    """A homed machine with axes that swing. Use as a context manager."""

    def __init__(self, gantry: GantryParams, seed: int = 1) -> None:
        physics = PlantParams(gantry=gantry)
        plate = part.plate(0.05, 0.05, 0.01, physics.metal.cell, 1e-3)
        self.plant = Plant(plate, physics, seed)
        self.machine = Machine(BridgeParams(), self.plant)
        self.off: list[np.ndarray] = []  # deviation at the end of every exchange
        self.table: list[np.ndarray] = []
        self._blocks: list[np.ndarray] = []
        self._index, self._at = 0, (0.0, 0.0, 0.0)
        m = self.machine
        m.on_exchange = self._on_exchange
        m.connect()
        for code in (commands.RESET, commands.HOME):
            assert m.command(commands.Command(code))[0] == 0
        homed = frames.HOMED
        assert m.until(lambda: bool(m.bridge.flags & homed) and m.bridge.state == frames.IDLE, 60.0)
        assert m.bridge.position is not None
        self._at = m.bridge.position

    def __enter__(self) -> Shaker:
        return self

    def __exit__(self, *_: object) -> None:
        self.machine.close()

    def _on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        seen = plant.accelerations()
        if seen is not None:
            self._blocks.append(seen.values)
        self.off.append(plant.gantry.deviation.copy())

    def configure(self, settings: list[tuple[str, float]]) -> str:
        """Tells the controller; returns its last answer."""
        said = ''
        for name, value in settings:
            code, said = self.machine.command(
                commands.Command(commands.CONFIGURE, name, (), (0, 0, 0), value)
            )
            assert code == 0, said
        return said

    def go(self, *points: tuple[tuple[float, float, float], float]) -> None:
        """Straight moves to points (m) at speeds (m/s), to the end."""
        moves = []
        for to, speed in points:
            moves.append(Segment(self._index, Kind.IDLE, self._at, to, speed))
            self._index, self._at = self._index + 1, to
        self.run(moves)

    def run(self, moves: list[Segment]) -> None:
        bridge = self.machine.bridge
        for k in range(0, len(moves), 1000):
            batch = moves[k : k + 1000]
            bridge.commit(
                permit := bridge.permit('shake', batch), program.prepare(permit, batch, False)
            )
        last = moves[-1].index
        self._index, self._at = last + 1, moves[-1].end
        assert self.machine.until(lambda: bridge.done >= last, 600.0), bridge.message
        assert self.machine.until(lambda: bridge.state == frames.IDLE, 5.0)

    def take(self) -> np.ndarray:
        blocks, self._blocks = self._blocks, []
        return np.concatenate(blocks)

    def sweep(self, sweep: Sweep, axis: str) -> Samples:
        """Moves to the probe point and shakes an axis."""
        self.go((POINT, 0.1))
        self.plant.sensing = True
        self.machine.advance(0.5)
        self.take()
        self.machine.advance(2.5)
        rest = self.take()
        self.run(sweep.segments(axis, POINT, self._index))
        values = self.take()
        self.plant.sensing = False
        p = self.plant.params.gantry
        return Samples(values, rest, SENSOR_RATE, p.sensor_range)
