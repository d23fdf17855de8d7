"""Moves a Plant along straight lines without controller or ROS: for tests, benches and pictures."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from waam_process.plant_port import SAMPLE

from .plant import OUTPUT_ARC, OUTPUT_GAS, SAMPLE_US, Plant, Reading

STEP = 10
Point = tuple[float, float, float]


class Drive:
    """A perfect machine: constant speed on every line, outputs as asked. `time_us` is the controller's clock."""

    def __init__(self, plant: Plant, start: Point, time_us: int = 1_000_000) -> None:
        """`start`: position of the wire tip in the work frame, m."""
        self.plant, self.position, self.time_us = plant, np.array(start, float), time_us
        self.profiles: list = []

    def _live(self, path: np.ndarray, wire: float, voltage: float, outputs: int) -> list[Reading]:
        tip = path + np.array(self.plant.params.work_zero)
        everything = np.zeros(len(path), SAMPLE)
        everything['table_x'], everything['table_y'], everything['tool_z'] = (
            -tip[:, 0],
            -tip[:, 1],
            tip[:, 2],
        )
        everything['wire_cmd'], everything['voltage_set'], everything['outputs'] = (
            wire,
            voltage,
            outputs,
        )
        readings = []
        for i in range(0, len(path), STEP):
            samples = everything[i : i + STEP]
            self.time_us += STEP * SAMPLE_US
            readings.append(self.plant.step(samples, self.time_us))
            if (seen := self.plant.profiles(samples)) is not None:
                self.profiles.append(seen)
        self.position = path[-1]
        return readings

    def wait(
        self, seconds: float, wire: float = 0.0, voltage: float = 0.0, outputs: int = 0
    ) -> list[Reading]:
        """Stands still (to the next 10 ms)."""
        n = STEP * max(1, round(seconds * 100))
        return self._live(np.repeat(self.position[None], n, axis=0), wire, voltage, outputs)

    def move(
        self, to: Point, speed: float, wire: float = 0.0, voltage: float = 0.0, outputs: int = 0
    ) -> list[Reading]:
        """A straight line at constant speed (m/s)."""
        way = np.array(to, float) - self.position
        length = float(np.linalg.norm(way))
        n = STEP * max(1, round(length / speed * 100))
        f = np.arange(1, n + 1)[:, None] / n
        return self._live(self.position + f * way, wire, voltage, outputs)

    def bead(
        self, points: Iterable[Point], speed: float, wire: float = 5 / 60, voltage: float = 22.0
    ) -> list[Reading]:
        """Goes to the first point, strikes the arc, follows the others, ends the arc. Readings while depositing."""
        first, *rest = points
        x, y, _ = self.position
        top = max(self.position[2], first[2]) + 5e-3
        self.move((x, y, top), 0.05)
        self.move((first[0], first[1], top), 0.05)
        self.move(first, 0.05)
        self.wait(0.1, outputs=OUTPUT_GAS)
        on = OUTPUT_ARC | OUTPUT_GAS
        for _ in range(300):
            self.wait(0.01, wire, voltage, on)
            if self.plant.arc_on:
                break
        readings = []
        for point in rest:
            readings += self.move(point, speed, wire, voltage, on)
        self.wait(0.1, outputs=OUTPUT_GAS)
        return readings
