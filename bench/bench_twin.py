"""`waam lab fit` on cells whose parameters are hidden from it.

twin.coverage: share of the true values inside the 90 % intervals, over ten hidden cells, of the parameters that differ
between these cells and that the fit says it was told (baseline: 0.9, what the intervals promise); twin.coverage_all:
the same with those that it says it was not told;
twin.forecast_error_pct: mean over the cells of the error of the RMS that the laboratory forecasts for the next job,
another part, on the fitted cell, against the mean of four such jobs on the hidden one (baseline: forecast on the
packaged cell);

A hidden cell leaves two job folders; the fit sees nothing else. WAAM_BENCH_KEEP=FOLDER keeps records, fits and
forecasts there, and a run that was ended goes on. WAAM_BENCH_CELLS (10) shrinks it; `0-4` takes a part of them.
"""

from __future__ import annotations

import math
import os
import pickle
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from lib import twin_cells
from lib.emit import emit

RECORDS, NEXT, FORECASTS = 2, 4, 2
NEXT_PART = 500


def cells() -> range:
    text = os.environ.get('WAAM_BENCH_CELLS', '10')
    first, dash, last = text.partition('-')
    return range(int(first), int(last) + 1) if dash else range(int(first))


def kept(file: Path, make: Callable[[], Any]) -> Any:
    """What is in the file, or made and put there."""
    if file.exists():
        return pickle.loads(file.read_bytes())
    made = make()
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix('.part')
    unfinished.write_bytes(pickle.dumps(made))
    os.replace(unfinished, file)
    return made


def lay(folder: Path, name: str, part: int, plant: Any, seed: int, keep: bool = False) -> Any:
    """Result of one job of the laboratory."""
    from waam_lab import run

    return kept(
        folder / f'{name}.pickle', lambda: run(twin_cells.job(folder, part, plant, seed, keep))
    )


def records(folder: Path, cell: int) -> list:
    from waam_lab.twin.records import read

    laid = [
        lay(
            folder,
            f'record{k}',
            RECORDS * cell + k,
            twin_cells.hidden(cell),
            9000 + 100 * cell + k,
            True,
        )
        for k in range(RECORDS)
    ]
    return [read(r.folder) for r in laid]


def fitted(folder: Path, cell: int) -> tuple[Any, list]:
    """The cell that was found and its estimates."""
    from waam_lab.twin.fit import fit
    from waam_sim.plant import PlantParams

    def make() -> tuple[Any, list]:
        found = fit(records(folder, cell), PlantParams())
        return found.cell, list(found.estimates)

    return kept(folder / 'fit.pickle', make)


def mean_rms(folder: Path, name: str, plant: Any, seed: int, count: int) -> float:
    laid = [lay(folder, f'{name}{k}', NEXT_PART, plant, seed + k) for k in range(count)]
    done = [r.rms for r in laid if not r.failed]
    return float(np.mean(done)) if done else math.nan


def one(keep: Path, number: int, usual: float) -> tuple[list, float, float]:
    """(name, told, inside) of the parameters that differ between cells; errors of both forecasts, %."""
    folder, true = keep / f'cell{number}', twin_cells.hidden(number)
    cell, estimates = fitted(folder, number)
    found = []
    for e in estimates:
        group, field = e.unknown.group, e.unknown.field
        value, other = (
            getattr(getattr(twin_cells.hidden(n), group), field) for n in (number, number + 1)
        )
        if value != other:
            found.append((e.unknown.name, e.told, e.low <= value <= e.high))
    actual = mean_rms(folder, 'next', true, 9000 + 100 * number + 50, NEXT)
    told = mean_rms(folder, 'forecast', cell, 6000 + 100 * number, FORECASTS)
    errors = [100 * abs(v / actual - 1) for v in (told, usual)]
    outside = [n for n, t, inside in found if not inside]
    said = f'next {actual * 1e6:.0f} um, forecast {told * 1e6:.0f}, packaged {usual * 1e6:.0f}'
    print(
        f'cell {number}: {said}; outside: {", ".join(outside) or "none"}',
        file=sys.stderr,
        flush=True,
    )
    return found, errors[0], errors[1]


def hidden_cells(keep: Path) -> None:
    usual = mean_rms(keep / 'packaged', 'next', None, 8000, NEXT)
    all_found, errors = [], []
    for number in cells():
        found, fit_error, usual_error = one(keep, number, usual)
        all_found += found
        errors.append((fit_error, usual_error))
    told = [inside for _, t, inside in all_found if t]
    for name in dict.fromkeys(n for n, _, _ in all_found):
        mine = [(t, i) for n, t, i in all_found if n == name]
        said = f'told {sum(t for t, _ in mine)}, inside {sum(i for _, i in mine)} of {len(mine)}'
        print(f'{name}: {said}', file=sys.stderr)
    emit('twin.coverage', float(np.mean(told)), '', 'what the intervals promise', 0.9)
    every = float(np.mean([i for _, _, i in all_found]))
    emit('twin.coverage_all', every, '', 'what the intervals promise', 0.9)
    foretold = [pair for pair in errors if math.isfinite(pair[0])]
    fit_error, usual_error = np.mean(foretold, axis=0)
    left = len(errors) - len(foretold)
    beside = f'the packaged cell; every forecast failed for {left} of {len(errors)} cells'
    emit('twin.forecast_error_pct', fit_error, '%', beside, float(usual_error))


def cells_found() -> None:
    """In the folder of WAAM_BENCH_KEEP, or in one that goes away."""
    if place := os.environ.get('WAAM_BENCH_KEEP'):
        hidden_cells(Path(place).resolve())
        return
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        hidden_cells(Path(scratch))


FIGURES = {
    'twin.coverage': cells_found,
    'twin.coverage_all': cells_found,
    'twin.forecast_error_pct': cells_found,
}
