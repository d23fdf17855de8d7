"""Pads laid on the simulated cell itself, with any of its metal models, layer by layer as a job does it, but bead by
bead and without a controller: scan, correct, set, lay.

What the cell's own loop does not have here: acceleration at the corners, the controller's wire loop, links that burn.
What is as in a job: wire drive, arc, heat, scatter, contact distance that changes with the error of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from waam_adapt import filters
from waam_adapt.feed import feed_forward as ff
from waam_adapt.laws.checks import MapOrigin
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.types import (
    MIN_GAIN,
    Correction,
    CorrectionInput,
    LastLayer,
    error_figures,
    nothing,
)
from waam_lab.plants import CHOOSING, family_plant
from waam_process import materials
from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec, HeightGrid
from waam_process.heat import heat_factor
from waam_process.plant_port import SAMPLE
from waam_process.segment import Kind
from waam_sim import part as parts
from waam_sim.plant import OUTPUT_ARC, OUTPUT_GAS, SAMPLE_US, Plant, PlantParams
from waam_sim.variation import VariationParams

MATERIAL = materials.get('er70s-6')
LIMITS = ff.Limits.of(MATERIAL, (3e-3, 20e-3), (2 / 60, 12 / 60))
LENGTH, BREADTH, HEIGHT = 48e-3, 28.8e-3, 2e-3  # m, of a pad and of its layers
CELL, STEP = 0.8e-3, 3e-3  # m, of the map; length of a segment
BELIEVED_WIDTH, GAIN, K_GAIN = 6e-3, 0.9, 0.3  # of the correction
MARGIN = 6e-3  # m, plate around the pad
EDGE, ENDS = 2e-3, 5e-3  # m: the flank that is not judged; ends of the beads
WEAR, SCAN_SIGMA = 1e-3, 30e-6  # m: of the ground under the pad; of the scanner
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


@dataclass(frozen=True)
class Proportional:
    """The plain law of published cells, as a baseline: psi = -gain*error/(k_gain*planned), cell by cell, without
    neighbours, knowledge of the bead or residual for the feed."""

    gain: float = GAIN
    name: str = 'proportional'

    def correct(self, request: CorrectionInput) -> Correction:
        """psi 0 where the map or the footprint is unknown."""
        if request.k_gain < MIN_GAIN:
            return nothing(request.z.shape, request.k_gain, self.name)
        known = request.footprint & np.isfinite(request.error)
        missing = np.where(known, request.error, 0.0) / np.where(known, request.planned, 1.0)
        psi = np.clip(-self.gain * missing / request.k_gain, -1.0, 1.0)
        confidence = np.where(known, filters.reliability(request.sigma, known.shape), 0.0)
        return Correction(psi, confidence, np.zeros_like(psi), self.name, request.k_gain)


@dataclass
class Run:
    """figures: RMS inside and with ends after every layer, m; foretold: for every layer but the last whether the
    surface after it had an RMS inside of the stated 90 % interval."""

    figures: list[tuple[float, float]] = field(default_factory=list)
    foretold: list[bool] = field(default_factory=list)


def run(pad: Pad, law: str, layers: int) -> Run:
    """The correction chain of the cell around a pad; `law` of the correction server, or 'proportional'."""
    plain = law == Proportional.name
    server = Corrector(CorrectionParams(law='zero' if plain else law, gain=GAIN, k_gain=K_GAIN))
    if plain:
        server.law = Proportional()
    out, last, told = Run(), LastLayer(), None
    for n in range(1, layers + 1):
        z, paths = pad.scan(), pad.bead_paths(n)
        request = CorrectionInput(
            z, np.full(z.shape, (n - 1) * HEIGHT), pad.planned, CELL, BELIEVED_WIDTH, K_GAIN,
            np.full(z.shape, SCAN_SIGMA), (1.0, 0.0), paths=paths, temperature=pad.temperature,
        )  # fmt: skip
        answer = server.answer(
            n, request, MapOrigin(0.0, 'bench', 'bench', n - 1, n - 1, True), last
        )
        if told is not None:
            out.foretold.append(told.low <= error_figures(request)[0] <= told.high)
        told, c = answer.outcome, answer.correction
        path = ff.Path(**pad.path(n))
        heat = float(heat_factor(pad.temperature, MATERIAL))
        f = ff.Field(pad.spec, c.psi, c.residual_height, c.k_gain, answer.flow_factor)
        s = ff.compute(path, MATERIAL, LIMITS, MATERIAL.voltage, f, True, heat)
        asked = np.where(pad.planned > 0, pad.planned / c.speed_factor + c.residual_height, 0.0)
        last = LastLayer(z, asked, answer.flow_factor)
        pad.deposit(path.start, path.end, s.wire_feed_speed, s.speed)
        out.figures.append(pad.figures(n))
    return out


class Pad:
    """Beads along x on a simulated cell, laid in a zig-zag that turns round with every layer. strip: m, breadth of a
    strip across the beads that no scan ever sees."""

    def __init__(self, seed: int, cell: PlantParams, strip: float = 0.0) -> None:
        self.cell, self.strip = cell, strip
        self.spec = GridSpec.covering(-MARGIN, -MARGIN, LENGTH + MARGIN, BREADTH + MARGIN, CELL)
        self.scan_rng = np.random.default_rng(10_000 + seed)
        ground = np.random.default_rng(20_000 + seed).standard_normal(self.spec.shape)
        rough = gaussian_filter(ground, 8e-3 / CELL)
        x, y = np.meshgrid(self.spec.x, self.spec.y)
        inside = (x > 0) & (x < LENGTH) & (y > 0) & (y < BREADTH)
        self.planned = np.where(inside, HEIGHT, 0.0)
        self.judged = (x > EDGE) & (x < LENGTH - EDGE) & (y > EDGE) & (y < BREADTH - EDGE)
        self.ends = self.judged & (np.minimum(x, LENGTH - x) < ENDS)
        self.temperature = 60.0
        n = round(BREADTH / MATERIAL.pitch)
        self.beads = (np.arange(n) + 0.5) * BREADTH / n
        metal = cell.metal
        plate = parts.plate(
            LENGTH + 2 * MARGIN, BREADTH + 2 * MARGIN, BASE, metal.cell, metal.margin
        )
        x, y = np.meshgrid(plate.spec.x - MARGIN, plate.spec.y - MARGIN)
        uneven = _at(self.spec, WEAR * rough / np.abs(rough).max(), x, y)
        z = np.where(plate.z > 0, plate.z + uneven, 0.0)
        self.plant = Plant(HeightGrid(plate.spec, z), cell, seed)
        self.laid, self.time_us = 0, 1_000_000
        self._see()

    def path(self, layer: int) -> dict[str, np.ndarray]:
        """Planned segments of a layer from 1, arrays by the names of `feed_forward.Path`."""
        edges = np.linspace(0, LENGTH, round(LENGTH / STEP) + 1)
        start, end = [], []
        for i, y in enumerate(self.beads):
            x = edges if (i + layer) % 2 == 0 else edges[::-1]
            start += [(a, y, 0.0) for a in x[:-1]]
            end += [(b, y, 0.0) for b in x[1:]]
        n = len(start)
        return {
            'index': np.arange(n), 'kind': np.full(n, int(Kind.DEPOSIT)), 'start': np.array(start),
            'end': np.array(end), 'height': np.full(n, HEIGHT),
            'width': np.full(n, BREADTH / len(self.beads) / AREA_FACTOR),
            'speed': np.full(n, MATERIAL.speed),
        }  # fmt: skip

    def bead_paths(self, layer: int) -> tuple[np.ndarray, ...]:
        """Lines from arc on to arc off in order, with the ends of the segments; (n, 2) m from the corner of the map."""
        p = self.path(layer)
        n = len(p['index']) // len(self.beads)
        corner = np.array([self.spec.origin_x, self.spec.origin_y])
        return tuple(
            np.concatenate([p['start'][i : i + n, :2], p['end'][i + n - 1 : i + n, :2]]) - corner
            for i in range(0, len(p['index']), n)
        )

    def scan(self) -> np.ndarray:
        """The surface as the scanner sees it: noise, 1 % of holes, without the strip."""
        z = self.z + SCAN_SIGMA * self.scan_rng.standard_normal(self.z.shape)
        z[self.scan_rng.random(z.shape) < 0.01] = np.nan
        z[:, np.abs(self.spec.x - 0.5 * LENGTH) < 0.5 * self.strip] = np.nan
        return z

    def figures(self, laid: int) -> tuple[float, float]:
        """RMS error without the last 5 mm at the ends of the beads, and of all, m."""
        e = self.z - laid * HEIGHT
        inside, whole = (
            float(np.sqrt(np.mean(e[p] ** 2))) for p in (self.judged & ~self.ends, self.judged)
        )
        return inside, whole

    def _see(self) -> None:
        """z (rows, cols) m over the plate, means over the cells of the plant."""
        x, y = np.meshgrid(self.spec.x + MARGIN, self.spec.y + MARGIN)
        spec, metal, quarter = self.plant.metal.spec, self.plant.metal.z, 0.25 * CELL
        seen = [
            _at(spec, metal, x + dx, y + dy)
            for dx in (-quarter, quarter)
            for dy in (-quarter, quarter)
        ]
        self.z = np.mean(seen, axis=0) - BASE

    def deposit(self, start, end, feed, speed) -> None:
        """Lays one layer and waits until it is cool."""
        top = BASE + self.laid * HEIGHT
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
        x, y, z = (path + np.array(self.cell.work_zero)).T
        samples['table_x'], samples['table_y'], samples['tool_z'] = -x, -y, z
        samples['wire_cmd'], samples['outputs'] = wire, outputs
        samples['voltage_set'] = MATERIAL.voltage if outputs & OUTPUT_ARC else 0.0
        self.time_us += SAMPLE_US * len(path)
        self.plant.step(samples, self.time_us)


def _at(spec: GridSpec, z: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    at = [(y - spec.origin_y) / spec.resolution - 0.5, (x - spec.origin_x) / spec.resolution - 0.5]
    return map_coordinates(z, at, order=1, mode='nearest')
