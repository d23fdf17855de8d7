"""Forecasts before metal (`waam forecast`) against what then came out, on the preset `recorded`: the reporting half
of the kinds of `lib/shop.py`, each as laid within ±0.3 mm and with finish `machined`.

A forecast never sees the cell of its job: its cells have two of the three metal models, the job is laid on three cells
of the third one, with other seeds and other physics. The models take turns from case to case.

`shop.forecast_coverage`: share of outcomes within the 90 % bands (RMS and share in tolerance, or clean share and mean
stock). `shop.forecast_error_pct`: how far the expected RMS, or mean stock, lies from the mean of the outcomes, mean
over the cases. `shop.forecast_seconds`: the longest forecast. `shop.told_share`: of the jobs that failed those that
were told so; `shop.false_alarms`: of the jobs that succeeded those that were told to fail. Baseline: what is wanted.

`shop.scrap_layers`: layers that a job lays before it pauses although a cone that overhangs by 30 degrees cannot be
built level on the simulated cell, less the first one, which shows it; all of them where it does not pause; mean over
three cells. `WAAM_BENCH_PRESET` chooses another preset.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from lib import shop
from lib.preset import emit_on_cell as emit
from lib.preset import preset
from lib.seeds import seeds

OUTCOMES = 3  # cells of every case
FIRST_OUTCOME = 20_000  # seed of the first of them; no forecast has one
GOALS = ({'tolerance': 0.3e-3}, {'plan_settings': ('finish=machined',)})
WANTED = {
    'coverage': ('', 0.9), 'error_pct': ('%', 15.0), 'seconds': ('s', 60.0), 'told_share': ('', 0.9),
    'false_alarms': ('', 0.1),
}  # fmt: skip
NAMES = {
    k: f'shop.{k}' if k in ('told_share', 'false_alarms') else f'shop.forecast_{k}' for k in WANTED
}


def forecasts() -> None:
    from waam_lab import restore

    on = preset('recorded')
    cases: list[tuple] = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in shop.KINDS['reporting']:
            paths = shop.write(Path(folder), kind)
            for goal in GOALS:
                job = restore(*paths, name=kind, preset=on, **goal)
                cases.append(_case(job, len(cases)))
    inside = [hit for f, results in cases for hit in _inside(f, results)]
    errors = [_error(f, results) for f, results in cases]
    told = [(f.fails, r.in_tolerance) for f, results in cases for r in results]
    failed, fine = ([fails for fails, good in told if good is which] for which in (False, True))
    values = {
        'coverage': np.mean(inside),
        'error_pct': 100 * np.mean(errors),
        'seconds': max(f.seconds for f, _ in cases),
        'told_share': np.mean(failed) if failed else 1.0,
        'false_alarms': np.mean(fine) if fine else 0.0,
    }
    print(f'{len(failed)} jobs failed, {len(fine)} succeeded', file=sys.stderr)
    for name, (unit, wanted) in WANTED.items():
        emit(NAMES[name], float(values[name]), unit, 'wanted', wanted, on)


def _case(job, number: int) -> tuple:
    """The forecast, and the results on cells of the metal model that it has not seen."""
    from dataclasses import replace

    from waam_lab import run_many
    from waam_lab.cli_forecast import foretell
    from waam_lab.forecast import verdict
    from waam_lab.plants import MODELS, training_plant

    workers = int(os.environ.get('WAAM_BENCH_WORKERS', '2'))
    unseen = MODELS[number % len(MODELS)]
    f = foretell(job, workers=workers, models=[m for m in MODELS if m != unseen])
    seeds = range(FIRST_OUTCOME + OUTCOMES * number, FIRST_OUTCOME + OUTCOMES * (number + 1))
    plants = {s: training_plant(np.random.default_rng(s), job.preset, unseen) for s in seeds}
    results = run_many([replace(job, seed=s, plant=p) for s, p in plants.items()], workers=workers)
    if failed := [r for r in results if r.failed]:
        raise RuntimeError(f'{job.goal.name}, seed {failed[0].seed}: {failed[0].message}')
    figure = _main(f)
    e = f.rows[figure]
    came = ', '.join(f'{getattr(r, figure.name) * 1e3:.3f}' for r in results)
    print(
        f'{job.goal.name} on {unseen}: {verdict(f)}, {figure.label} {e.value * 1e3:.3f} mm '
        f'({e.low * 1e3:.3f} to {e.high * 1e3:.3f}), {len(f.results)} cells, {f.seconds:.0f} s; came {came} mm, '
        f'{sum(r.in_tolerance for r in results)} of {len(results)} succeeded',
        file=sys.stderr,
    )
    return f, results


def _main(f):
    """The figure in mm by which a forecast is measured."""
    from waam_lab.forecast import RMS, STOCK

    return STOCK if f.machined else RMS


def _inside(f, results) -> list[bool]:
    """Whether every outcome lies in its band."""
    from waam_lab.forecast import CLEAN, SHARE_ROW

    rows = (_main(f), CLEAN if f.machined else SHARE_ROW)
    return [
        f.rows[row].low <= getattr(r, row.name) <= f.rows[row].high for row in rows for r in results
    ]


def _error(f, results) -> float:
    row = _main(f)
    came = float(np.mean([getattr(r, row.name) for r in results]))
    return abs(f.rows[row].value / came - 1)


def scrap() -> None:
    from waam_lab import build, run_many

    on = preset('recorded')
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'cone.stl'
        _cone(file)
        workers = int(os.environ.get('WAAM_BENCH_WORKERS', '2'))
        found = run_many(
            [build(file, seed=s, preset=on) for s in seeds((1, 2, 3))], workers=workers
        )
    scrap_layers = []
    for r in found:
        held = [a for a in r.anomalies if 'job paused' in a['reaction'] and a['class'] == 'height']
        scrap_layers.append((held[0]['layer'] if held else r.layers) - 1)
        print(f'seed {r.seed}: {held[0]["text"] if held else "no pause"}', file=sys.stderr)
    emit('shop.scrap_layers', float(np.mean(scrap_layers)), '', 'wanted', 2.0, on)


def _cone(file: Path) -> None:
    """24 mm high, radius 12 mm below, opening by 30 degrees."""
    import trimesh

    top = 12 + 24 * np.tan(np.radians(30))
    outline = np.array([[0, 0], [12, 0], [top, 24], [0, 24]], float)
    trimesh.creation.revolve(outline, sections=72).export(file)


FIGURES = {**dict.fromkeys(NAMES.values(), forecasts), 'shop.scrap_layers': scrap}
