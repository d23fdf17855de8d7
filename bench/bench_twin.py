"""`waam lab fit` on cells whose parameters are hidden from it.

twin.coverage: share of the true values inside the 90 % intervals, over ten hidden cells, of the parameters that differ
between these cells and that the fit says it was told (baseline: 0.9, what the intervals promise); twin.coverage_all:
the same with those that it says it was not told;
twin.forecast_error_pct: mean over the cells of the error of the RMS that the laboratory forecasts for the next job,
another part, on the fitted cell, against the mean of four such jobs on the hidden one (baseline: forecast on the
packaged cell).

A hidden cell leaves two job folders; the fit sees nothing else. WAAM_BENCH_CELLS (10) shrinks it.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from lib.emit import emit

from waam_lab import restore, run
from waam_lab.job import LabResult
from waam_lab.parts import Shape
from waam_sim.plant import PlantParams

RECORDS, NEXT, FORECASTS = 2, 4, 2
NEXT_PART = 500
CELLS = int(os.environ.get('WAAM_BENCH_CELLS', '10'))
FIRST = 7100  # of the seeds of hidden cells; no other bench and no training uses them


def hidden(number: int) -> PlantParams:
    """Parameters that only this function knows. They spread about the packaged ones as cells do, in all that
    `waam lab fit` looks for; nothing here reads the priors of the fit."""
    rng = np.random.default_rng([FIRST, number])
    usual = PlantParams()
    metal = replace(
        usual.metal,
        transfer=float(rng.uniform(0.80, 0.96)),
        width_ref=float(np.clip(rng.normal(7e-3, 0.35e-3), 6.2e-3, 7.9e-3)),
        levelling=float(np.clip(rng.normal(0.55, 0.12), 0.25, 0.85)),
        pool_lag=float(np.clip(rng.normal(0.45, 0.15), 0.1, 0.9)),
        crater_depth=float(rng.uniform(0.15, 0.6)),
        start_narrowing=float(rng.uniform(0.05, 0.3)),
        area_noise_layer=float(rng.uniform(0.02, 0.06)),
    )
    heat = replace(
        usual.heat,
        arc_efficiency=float(np.clip(rng.normal(0.8, 0.05), 0.65, 0.92)),
        table_conductance=float(450.0 * np.exp(rng.normal(0.0, 0.35))),
    )
    arc = replace(
        usual.arc,
        current_ref=float(rng.normal(138.0, 7.0)),
        current_exponent=float(np.clip(rng.normal(0.65, 0.05), 0.5, 0.8)),
        current_per_m=float(np.clip(rng.normal(24.0, 4.0), 12.0, 36.0)),
        length_noise=float(rng.uniform(0.25, 0.7)),
        current_noise=float(rng.uniform(4.0, 10.0)),
        sensor_noise=float(rng.uniform(0.8, 2.5)),
    )
    return replace(usual, metal=metal, heat=heat, arc=arc)


def write_part(folder: Path, number: int) -> tuple[Path, Path]:
    """Nominal and worn mesh of a block of some 45 x 30 mm whose top is worn by 3 to 5 mm, unevenly."""
    rng = np.random.default_rng([FIRST, 1, number])
    length, width = rng.uniform(40, 52), rng.uniform(24, 34)
    x, y = np.meshgrid(
        np.linspace(0, length, round(length) + 1),
        np.linspace(0, width, round(width) + 1),
        indexing='ij',
    )
    wear = rng.uniform(3.2, 4.6) + rng.uniform(-0.6, 0.6) * (x / length - 0.5)
    wear += 0.3 * np.sin(x / rng.uniform(6, 12)) * np.cos(y / rng.uniform(6, 12))
    kept = np.ones((x.shape[0] - 1, x.shape[1] - 1), bool)
    made = Shape(np.stack([x, y], axis=2), kept, np.full(x.shape, 18.0), 18.0 - wear)
    paths = folder / f'block{number}_nominal.stl', folder / f'block{number}_worn.stl'
    for mesh, path in zip(made.meshes(), paths, strict=True):
        mesh.export(path)
    return paths


def lay(
    folder: Path, part: int, plant: PlantParams | None, seed: int, keep: bool = False
) -> LabResult:
    """The restoration of part `part` in the laboratory; kept in folder/jobs when it is to be kept."""
    options = {'plant': plant, 'keep': keep, 'jobs_dir': folder / 'jobs', 'tolerance': 0.2e-3}
    return run(restore(*write_part(folder, part), seed, **options))


def mean_rms(folder: Path, plant: PlantParams | None, seed: int, count: int) -> float:
    """m, of the next job; NaN when all of them fail."""
    laid = [lay(folder, NEXT_PART, plant, seed + k) for k in range(count)]
    done = [r.rms for r in laid if not r.failed]
    return float(np.mean(done)) if done else math.nan


def one(folder: Path, number: int, usual: float) -> tuple[list, float, float]:
    """(told, inside) of the parameters that differ between cells; errors of both forecasts, %."""
    from waam_lab.twin.fit import fit
    from waam_lab.twin.records import read

    true, another, seed = hidden(number), hidden(number + 1), 9000 + 100 * number
    laid = [lay(folder, RECORDS * number + k, true, seed + k, True) for k in range(RECORDS)]
    fitted = fit([read(r.folder) for r in laid], PlantParams())
    found, outside = [], []
    for e in fitted.estimates:
        value, other = (
            getattr(getattr(p, e.unknown.group), e.unknown.field) for p in (true, another)
        )
        if value != other:
            found.append((e.told, e.low <= value <= e.high))
            outside += [] if found[-1][1] else [e.unknown.name]
    actual = mean_rms(folder, true, seed + 50, NEXT)
    told = mean_rms(folder, fitted.cell, 6000 + 100 * number, FORECASTS)
    said = f'next {actual * 1e6:.0f} um, forecast {told * 1e6:.0f}, packaged {usual * 1e6:.0f}'
    print(f'cell {number}: {said}; outside: {", ".join(outside) or "none"}', file=sys.stderr)
    return found, *(100 * abs(v / actual - 1) for v in (told, usual))


def hidden_cells() -> None:
    """All three figures."""
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        usual = mean_rms(Path(scratch), None, 8000, NEXT)
        rows = [one(Path(scratch), number, usual) for number in range(CELLS)]
    found = [pair for row in rows for pair in row[0]]
    promised = 'what the intervals promise'
    emit('twin.coverage', float(np.mean([i for t, i in found if t])), '', promised, 0.9)
    emit('twin.coverage_all', float(np.mean([i for _, i in found])), '', promised, 0.9)
    foretold = [row[1:] for row in rows if math.isfinite(row[1])]
    fit_error, usual_error = np.mean(foretold, axis=0)
    beside = (
        f'the packaged cell; every forecast failed for {CELLS - len(foretold)} of {CELLS} cells'
    )
    emit('twin.forecast_error_pct', fit_error, '%', beside, float(usual_error))


FIGURES = dict.fromkeys(
    ('twin.coverage', 'twin.coverage_all', 'twin.forecast_error_pct'), hidden_cells
)
