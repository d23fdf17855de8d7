"""A job folder as a real cell would leave it, made by laying beads on the simulated metal directly: quick, and every
parameter is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from waam_lab.twin.electric import current
from waam_lab.twin.records import JobRecord, LaidLayer
from waam_lab.twin.replay import Replay
from waam_process.grid import GridSpec
from waam_sim.arc import REFERENCE_CTWD
from waam_sim.plant import PlantParams

SPEC = GridSpec(-0.005, -0.005, 5e-4, 68, 92)
LENGTH, WIDTH, HIGH, PITCH, SPEED, WIRE = 0.036, 0.024, 0.02, 4e-3, 0.01, 0.08
PAUSE = 60.0


def telemetry(layers: int, arc) -> dict[str, np.ndarray]:
    """Beads along x, there and back, 10 rows a second; every second layer begins on the other side."""
    rows, clock = [], 100.0
    rng = np.random.default_rng(5)
    for number in range(1, layers + 1):
        z = HIGH + 1.6e-3 * (number - 1)
        ys = np.arange(2e-3, WIDTH, PITCH)
        for k, y in enumerate(ys if number % 2 else ys[::-1]):
            clock += 2.0
            ends = (1e-3, LENGTH - 1e-3) if k % 2 else (LENGTH - 1e-3, 1e-3)
            way = np.arange(0, abs(ends[1] - ends[0]) / SPEED, 0.1)
            wire = WIRE * (1 + 0.12 * np.sin(0.9 * way + number))
            x = ends[0] + np.sign(ends[1] - ends[0]) * SPEED * way
            contact = REFERENCE_CTWD + 1e-3 * rng.standard_normal()
            amps = current(arc, wire * arc.wire_ratio, np.full(way.size, contact))
            length = arc.length_noise * rng.standard_normal(way.size)
            amps += -arc.current_noise * length + arc.sensor_noise * rng.standard_normal(way.size)
            for i in range(way.size):
                lit = [
                    x[i],
                    y,
                    z + contact - REFERENCE_CTWD,
                    amps[i],
                    22.0 + length[i],
                    wire[i],
                    1.0,
                ]
                rows.append([clock + way[i], *lit, number, clock if i == 0 else np.nan])
            clock += way[-1] + 0.1
            rows.append([clock, x[-1], y, z, 0.0, 0.0, 0.0, 0.0, number, clock])
        for _ in range(int(PAUSE * 10)):
            clock += 0.1
            rows.append([clock, 0.0, 0.0, z + 0.05, 0.0, 0.0, 0.0, 0.0, 0, np.nan])
    names = ('t', 'x', 'y', 'z', 'current', 'voltage', 'wire_feed', 'arc', 'layer', 'arc_changed')
    quiet = [[50.0 + i, 0, 0, 0.1, 0, 0, 0, 0, 0, np.nan] for i in range(10)]
    return dict(zip(names, np.array(quiet + rows, float).T, strict=True))


def record(truth: PlantParams, layers: int = 2, seed: int = 3) -> JobRecord:
    """Of a plate of 36 x 24 mm on the cell `truth`."""
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    on = (x > 0) & (x < LENGTH) & (y > 0) & (y < WIDTH)
    ground = np.where(on, HIGH, 0.0)
    nominal = np.where(on, HIGH + 1.6e-3 * layers, np.nan)
    planned = np.where(on, 1.6e-3, 0.0)
    tm = telemetry(layers, truth.arc)
    spots = {n: (LENGTH / 2, WIDTH / 2) for n in range(1, layers + 1)}
    flat = tuple(LaidLayer(n, ground, ground, planned) for n in range(1, layers + 1))
    # NaN: nothing was scanned, so the layers of the maker stand on what it has laid itself
    tm['temperature'] = tm['t'] * 0 + np.arange(tm['t'].size) * 1e-6 + 22.0
    blind = tuple(replace(one, before=np.full(SPEC.shape, np.nan)) for one in flat[1:])
    made = Replay(JobRecord('made', SPEC, (flat[0], *blind), tm, nominal, spots))
    laid = made.run(truth, seed)
    rng = np.random.default_rng(seed)
    at = np.searchsorted(tm['t'], made.readings.t)
    tm['temperature'][:] = np.nan
    tm['temperature'][at] = laid.celsius + 0.5 * rng.standard_normal(at.size)
    surfaces = [ground]
    for n in range(1, layers + 1):
        surfaces.append(surfaces[-1] + laid.growth[n])
    seen = [s + 2e-5 * rng.standard_normal(s.shape) for s in surfaces]
    both = zip(seen, seen[1:], strict=False)
    found = tuple(LaidLayer(n + 1, a, b, planned) for n, (a, b) in enumerate(both))
    return JobRecord('made', SPEC, found, tm, nominal, spots)


def write(folder: Path, made: JobRecord) -> Path:
    """The record as a job folder."""
    (folder / 'layers').mkdir(parents=True)
    np.savez(folder / 'telemetry.npz', **made.telemetry)
    surfaces = [made.first, *(one.after for one in made.layers)]
    for n, z in enumerate(surfaces):
        np.savez(
            folder / f'layers/scan_{n:03d}.npz', z=z.astype(np.float32), nominal=made.nominal, layer=n,
            origin=np.array([SPEC.origin_x, SPEC.origin_y]), resolution=np.array(SPEC.resolution),
            planned=made.layers[0].planned,
        )  # fmt: skip
    ends = np.array([[1e-3, WIDTH / 2, HIGH], [LENGTH - 1e-3, WIDTH / 2, HIGH]])
    count = len(made.layers)
    np.savez(
        folder / 'plan.npz', kind=np.ones(count, np.uint8), layer=np.arange(1, count + 1),
        start=np.repeat(ends[:1], count, 0), end=np.repeat(ends[1:], count, 0), width=np.full(count, 6e-3),
    )  # fmt: skip
    return folder
