"""Pads laid on the simulated cell itself, with any of its metal models, bead by bead and without a controller.

What the cell's own loop does not have here: acceleration at the corners, the controller's wire loop, links that burn.
What is as in a job: wire drive, arc, heat, scatter, contact distance that changes with the error of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import map_coordinates

from waam_lab.plants import CHOOSING, family_plant
from waam_process.grid import HeightGrid
from waam_process.plant_port import SAMPLE
from waam_sim import part as parts
from waam_sim.plant import OUTPUT_ARC, OUTPUT_GAS, SAMPLE_US, Plant, PlantParams
from waam_sim.variation import VariationParams

from .adapt_plants import MARGIN, Pad

BASE = 20e-3  # m of plate under the pad
COOL, LONGEST = 120.0, 400.0  # degC that a layer waits for, and s at most
LIFT = 5e-3  # m between the beads
SCATTER = ('area_noise_fixed', 'area_noise_layer', 'width_noise')


DRIFTS = {
    'none': VariationParams(),
    'fall': VariationParams(efficiency_per_layer=-0.01),
    'walk': VariationParams(efficiency_walk=0.05),
}


def physics_of(
    model: str, cell: int, scatter: float, drift: str, seeds: int = CHOOSING
) -> PlantParams:
    """A random cell of a family with the packaged scatter times `scatter` and a drift of DRIFTS."""
    found, usual = family_plant(model, cell, seeds), PlantParams().metal
    noise = {name: scatter * getattr(usual, name) for name in SCATTER}
    metal = replace(found.metal, margin=2e-3, **noise)
    return replace(found, metal=metal, variation=DRIFTS[drift])


@dataclass
class CellPad(Pad):
    """A `Pad` whose metal is that of a simulated cell; its `physics` give the ground and the scanner alone."""

    cell: PlantParams = field(default_factory=PlantParams)
    strip: float = 0.0  # m, breadth of a strip across the beads that no scan ever sees

    def __post_init__(self) -> None:
        super().__post_init__()
        size = self.length + 2 * MARGIN, self.breadth + 2 * MARGIN
        metal = self.cell.metal
        plate = parts.plate(*size, BASE, metal.cell, metal.margin)
        x, y = np.meshgrid(plate.spec.x - MARGIN, plate.spec.y - MARGIN)
        rough = self._at(self.z, x, y)
        self.plant = Plant(
            HeightGrid(plate.spec, np.where(plate.z > 0, plate.z + rough, 0.0)),
            self.cell,
            self.seed,
        )
        self.laid, self.time_us = 0, 1_000_000
        self._see()

    def scan(self) -> np.ndarray:
        """The surface as the scanner sees it, without the strip."""
        z = super().scan()
        z[:, np.abs(self.spec.x - 0.5 * self.length) < 0.5 * self.strip] = np.nan
        return z

    def _at(self, z: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        s = self.spec
        at = [(y - s.origin_y) / s.resolution - 0.5, (x - s.origin_x) / s.resolution - 0.5]
        return map_coordinates(z, at, order=1, mode='nearest')

    def _see(self) -> None:
        """z (rows, cols) m over the plate, means over the cells of the plant."""
        s, metal = self.plant.metal.spec, self.plant.metal.z
        x, y = np.meshgrid(self.spec.x, self.spec.y)
        quarter = 0.25 * self.resolution
        seen = [
            map_coordinates(
                metal,
                [
                    (y + MARGIN + dy - s.origin_y) / s.resolution - 0.5,
                    (x + MARGIN + dx - s.origin_x) / s.resolution - 0.5,
                ],
                order=1,
                mode='nearest',
            )
            for dx in (-quarter, quarter)
            for dy in (-quarter, quarter)
        ]
        self.z = np.mean(seen, axis=0) - BASE

    def deposit(self, start, end, feed, speed, noisy: bool = True) -> None:
        """Lays one layer; the cell always scatters."""
        top = BASE + self.laid * self.height
        n = len(feed) // len(self.beads)
        for b in range(len(self.beads)):
            k = slice(b * n, (b + 1) * n)
            self._bead(start[k], end[k], feed[k], speed[k], top)
        waited = 0.0
        while waited < LONGEST and (waited < 20.0 or self.plant.heat.mean > COOL):
            self._live(np.repeat(self._tip[None] + (0.0, 0.0, LIFT), 10_000, axis=0), 0.0, 0)
            waited += 10.0
        self.temperature = self.plant.heat.mean
        self.laid += 1
        self._see()

    def _bead(self, start, end, feed, speed, top: float) -> None:
        first = np.array([start[0, 0] + MARGIN, start[0, 1] + MARGIN, top])
        self._tip = first
        self._live(np.repeat(first[None], 300, axis=0) + (0.0, 0.0, LIFT), 0.0, OUTPUT_GAS)
        on = OUTPUT_ARC | OUTPUT_GAS
        for _ in range(200):
            self._live(np.repeat(first[None], 10, axis=0), float(feed[0]), on)
            if self.plant.arc_on:
                break
        length = np.hypot(*(end - start)[:, :2].T)
        done = np.concatenate([[0.0], np.cumsum(length / speed)])
        t = np.arange(1, int(done[-1] * 1000) + 1) * 1e-3
        way = np.interp(t, done, np.concatenate([[0.0], np.cumsum(length)]))
        share = way / length.sum()
        last = np.array([end[-1, 0] + MARGIN, end[-1, 1] + MARGIN, top])
        path = first + share[:, None] * (last - first)
        piece = np.minimum(np.searchsorted(done, t, side='right') - 1, len(feed) - 1)
        self._tip = last
        self._live(path, np.asarray(feed)[piece], on)
        self._live(np.repeat(last[None], 100, axis=0), 0.0, OUTPUT_GAS)

    def _live(self, path: np.ndarray, wire: np.ndarray | float, outputs: int) -> None:
        """path (n, 3) m of the tip, one sample of 1 ms each."""
        samples = np.zeros(len(path), SAMPLE)
        tip = path + np.array(self.cell.work_zero)
        samples['table_x'], samples['table_y'], samples['tool_z'] = (
            -tip[:, 0],
            -tip[:, 1],
            tip[:, 2],
        )
        samples['wire_cmd'], samples['outputs'] = wire, outputs
        samples['voltage_set'] = self.material.voltage if outputs & OUTPUT_ARC else 0.0
        self.time_us += SAMPLE_US * len(path)
        self.plant.step(samples, self.time_us)
