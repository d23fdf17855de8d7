"""A bead with steps of speed on the real controller core and the simulated cell: for tests and benchmarks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_bridge import commands, frames, program
from waam_bridge.frames import ARC_ESTABLISHED, Telemetry
from waam_bridge.params import BridgeParams
from waam_calibrate.lead import WireRecord
from waam_lab.machine import Machine
from waam_process.segment import Kind, Point, Segment
from waam_sim import part
from waam_sim.plant import Plant, PlantParams

FEED = 0.08  # m/s of wire at SPEED
SPEED = 8e-3  # m/s
THICK, SAFE = 10e-3, 30e-3  # m: top of the plate, height of travel
JOB = 'calibrate'


class Layer:
    """A homed machine over a plate. Use as a context manager. `rows`: per exchange (10 ms) torch x, y (m, work), wire
    that really ran (m/s), metal laid (m3), whether the arc burns."""

    def __init__(self, physics: PlantParams, seed: int = 1, size: float = 0.2) -> None:
        plate = part.plate(size, 0.06, THICK, physics.metal.cell, 1e-3)
        self.plant = Plant(plate, physics, seed)
        self.machine = Machine(BridgeParams(), self.plant)
        self.frames: list[Telemetry] = []
        self.rows: list[tuple[float, ...]] = []
        self._index, self._laid = 0, 0.0
        m = self.machine
        m.on_frame, m.on_exchange = self.frames.append, self._on_exchange
        m.connect()
        for code in (commands.RESET, commands.HOME):
            self._order(commands.Command(code))
        self._rest(120.0)
        zero = physics.work_zero
        self._order(commands.Command(commands.SET_ZERO, '', (), zero))

    def __enter__(self) -> Layer:
        return self

    def __exit__(self, *_: object) -> None:
        self.machine.close()

    def _order(self, order: commands.Command) -> None:
        code, said = self.machine.command(order)
        assert code == 0, said

    def _rest(self, limit: float) -> None:
        bridge = self.machine.bridge
        still = self.machine.until(
            lambda: bool(bridge.flags & frames.HOMED) and bridge.state == frames.IDLE, limit
        )
        assert still, bridge.message

    def _on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        zero = plant.params.work_zero
        laid = plant.metal.deposited
        self.rows.append(
            (
                -float(samples['table_x'].mean()) - zero[0],
                -float(samples['table_y'].mean()) - zero[1],
                float(plant.arc.state['wire'][0]),
                laid - self._laid,
                float(plant.arc_on),
            )
        )
        self._laid = laid

    def configure(self, settings: list[tuple[str, float]]) -> None:
        """Tells the controller."""
        for name, value in settings:
            self._order(commands.Command(commands.CONFIGURE, name, (), (0, 0, 0), value))

    def bead(self, corners: list[Point], speeds: list[float], per_mm: float = FEED / SPEED) -> None:
        """From corner to corner with the arc on, at speeds (m/s), the same length of wire (per m) everywhere."""
        here = self.here()
        above = (corners[0][0], corners[0][1], SAFE)
        up = (here[0], here[1], SAFE)
        way = [(here, up), (up, above), (above, corners[0])]
        moves = [Segment(0, Kind.IDLE, a, b, 0.05) for a, b in way]
        moves += [
            Segment(
                0, Kind.DEPOSIT, a, b, v, arc=True, layer=1, bead=1, wire_feed_speed=per_mm * v, voltage=22.0,
                height=2e-3, width=6e-3, speed_programmed=v,
            )
            for a, b, v in zip(corners, corners[1:], speeds, strict=False)
        ]  # fmt: skip
        end = corners[-1]
        moves.append(Segment(0, Kind.IDLE, end, (end[0], end[1], SAFE), 0.05))
        self.run(moves)

    def here(self) -> Point:
        """m, work frame."""
        t = self.frames[-1]
        return t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6

    def run(self, moves: list[Segment]) -> None:
        """To the end."""
        numbered = [replace(s, index=self._index + i) for i, s in enumerate(moves)]
        self._index += len(moves)
        bridge = self.machine.bridge
        self._order(commands.Command(commands.ARM, JOB))
        permit = bridge.permit(JOB, numbered)
        bridge.commit(permit, program.prepare(permit, numbered, True))
        done = self.machine.until(lambda: bridge.done >= numbered[-1].index, 600.0)
        assert done, bridge.message
        self._rest(10.0)

    def take(self) -> tuple[WireRecord, np.ndarray]:
        """Telemetry and rows since the last call."""
        seen, self.frames = self.frames, self.frames[-1:]
        rows, self.rows = np.array(self.rows), []
        found = np.array(
            [
                (
                    t.t_us * 1e-6,
                    t.wire_cmd_um_s * 1e-6,
                    t.wire_um_s * 1e-6,
                    t.flags & ARC_ESTABLISHED,
                )
                for t in seen
            ]
        )
        return WireRecord(*found[:, :3].T, found[:, 3] > 0), rows


def staircase(
    pieces: int, length: float = 12e-3, factor: float = 1.5
) -> tuple[list[Point], list[float]]:
    """Corners along x and speeds: every second piece is faster."""
    corners: list[Point] = [(10e-3 + length * k, 30e-3, THICK) for k in range(pieces + 1)]
    return corners, [SPEED * (factor if k % 2 else 1.0) for k in range(pieces)]


def metal_errors(rows: np.ndarray, corners: list[Point], window: float) -> np.ndarray:
    """Relative errors (n,) of the wire per length of path, in windows (m) within 8 mm of every corner and step, against
    their median. rows: of `Layer.take`."""
    lit = np.flatnonzero(rows[:, 4] > 0)
    burnt = rows[lit[0] : lit[-1] + 1]
    way = np.cumsum(np.hypot(*np.diff(burnt[:, :2], axis=0, prepend=burnt[:1, :2]).T))
    places, last = np.unique(np.round(way[::-1], 9), return_index=True)
    wire = np.cumsum(0.01 * burnt[:, 2])[
        len(way) - 1 - last
    ]  # that has come when the torch leaves a place
    at = np.arange(0.5 * window, way[-1] - 0.5 * window, 1e-4)
    laid = np.interp(at + 0.5 * window, places, wire) - np.interp(at - 0.5 * window, places, wire)
    ends = np.cumsum(np.linalg.norm(np.diff(np.array(corners), axis=0), axis=1))
    near = (np.abs(at[:, None] - ends[None, :-1]) < 8e-3).any(axis=1)
    near &= (at > 8e-3) & (at < ends[-1] - 8e-3)  # the bead's own ends are another matter
    return laid[near] / np.median(laid[near]) - 1.0


def cornered() -> tuple[list[Point], list[float]]:
    """Steps of speed, two right angles, one of them with a step."""
    corners, speeds = staircase(6)
    x, y, z = corners[-1]
    return [*corners, (x, y + 12e-3, z), (x - 12e-3, y + 12e-3, z)], [*speeds, SPEED, 1.5 * SPEED]
