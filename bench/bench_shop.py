"""Parts of a repair shop (`lib/shop.py`): twelve kinds of restorations that nothing was chosen on, seeds 1 to 3.

Finish `machined`, preset `recorded`. `shop.cleans_up_share`: share of the jobs of which 99.5 % of the needed area are
at or above nominal; `shop.stock_mean_mm`, `shop.stock_99_mm`: what is to be machined off, mean and 99 % of what was
laid, mean over jobs; `shop.plan_told_share`: of the kinds that do not clean up in every job, the share of
which the plan warns; `shop.plan_false_alarms`: of the other kinds, the share of which it warns.
Finish `as-laid`, tolerance 0.2 mm, preset `gentle`: `shop.in_tolerance_share`, `shop.rms_mean_mm`, `shop.rms_worst_mm`;
on `recorded`: `shop.recorded_in_tolerance_share`, `shop.recorded_rms_mean_mm`, `shop.recorded_rms_worst_mm`. Baseline:
the same jobs without correction (open loop). A job that fails counts as neither clean nor in tolerance, and its other
figures are left out.

One line per job and a table per kind on stderr. In parts: `WAAM_BENCH_KIND=boss,cup_rim` chooses kinds,
`WAAM_BENCH_SEEDS=1,2` seeds, `WAAM_BENCH_CAMPAIGN=FILE` keeps the jobs, one JSON line each; what is in it is not
repeated. One file per version. `WAAM_BENCH_CHOOSING=1`: the twelve kinds on which rules and constants are chosen, seeds
101 and 102. `WAAM_BENCH_WORKERS`: number of processes (2). A job takes 6 to 20 s of processor time.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from lib import shop
from lib.preset import emit_on_cell as emit
from lib.seeds import seeds

CHOOSING = bool(os.environ.get('WAAM_BENCH_CHOOSING'))
HALF, SEEDS = ('choosing', (101, 102)) if CHOOSING else ('reporting', (1, 2, 3))
CLOSED, OPEN = 'closed_loop', 'open_loop'
OF_MACHINED = {
    'cleans_up_share': ('good', ''),
    'stock_mean_mm': ('stock', 'mm'),
    'stock_99_mm': ('high', 'mm'),
}
OF_LAID = {
    'in_tolerance_share': ('good', ''),
    'rms_mean_mm': ('rms', 'mm'),
    'rms_worst_mm': ('rms', 'mm'),
}
Row = dict[str, object]


def kinds() -> list[str]:
    """Those of the half, or those that WAAM_BENCH_KIND names."""
    named = os.environ.get('WAAM_BENCH_KIND', '')
    chosen = named.split(',') if named else list(shop.KINDS[HALF])
    if unknown := [k for k in chosen if k not in shop.ALL]:
        raise SystemExit(f'WAAM_BENCH_KIND: {unknown[0]} is none of {", ".join(shop.ALL)}')
    return chosen


def jobs(finish: str, on: str, loop: str) -> Iterator[tuple[str, Row]]:
    """Kind and row of every job, done now or read from WAAM_BENCH_CAMPAIGN."""
    kept = Path(os.environ.get('WAAM_BENCH_CAMPAIGN', os.devnull))
    known = [json.loads(line) for line in kept.read_text().splitlines()] if kept.is_file() else []
    rows = {tuple(r['job']): r for r in known}
    for kind in kinds():
        wanted = [(kind, seed, finish, on, loop) for seed in seeds(SEEDS)]
        for row in run([w for w in wanted if w not in rows]):
            rows[row['job']] = row
            with kept.open('a') as file:
                file.write(json.dumps(row) + '\n')
        for job in wanted:
            yield kind, rows[job]


def run(wanted: list[tuple]) -> Iterator[Row]:
    """Rows of jobs of one kind (kind, seed, finish, preset, loop mode)."""
    from waam_lab import restore, run_many

    with tempfile.TemporaryDirectory() as folder:
        todo = []
        for kind, seed, finish, on, loop in wanted:
            told = {'preset': on, 'loop_mode': loop, 'plan_settings': (f'finish={finish}',)}
            todo.append(restore(*shop.write(Path(folder), kind), seed=seed, name=kind, **told))
        found = run_many(todo, workers=int(os.environ.get('WAAM_BENCH_WORKERS', '2')))
    for job, result in zip(wanted, found, strict=True):
        row = row_of(job, result)
        print(line_of(row), file=sys.stderr, flush=True)
        yield row


def row_of(job: tuple, result) -> Row:
    """What is kept of a job; lengths in mm, NaN where it has none."""
    told = any('will not clean up' in a['text'] for a in result.anomalies)
    lengths = {'rms': result.rms, 'stock': result.stock_mean, 'high': result.stock_high}
    return {
        'job': job, 'good': bool(result.in_tolerance), 'told': told, 'message': result.message if result.failed else '',
        'clean': result.clean_share, 'share': result.share_in_tolerance,
        **{k: round(v * 1e3, 4) for k, v in lengths.items()},
    }  # fmt: skip


def line_of(row: Row) -> str:
    kind, seed, finish, on, loop = row['job']
    said = f'{"good" if row["good"] else "not good"}, RMS {row["rms"]:.3f} mm, {row["share"]:.1%} in tolerance'
    if finish == 'machined':
        said += (
            f', clean {row["clean"]:.2%}, stock {row["stock"]:.2f} mm, 99 % {row["high"]:.2f} mm'
        )
    said = row['message'] or said
    return f'{kind}, seed {seed}, {finish}, {on}, {loop}: {said}'


def mean(rows: list[Row], name: str, field: str) -> float:
    """Over the jobs that have it; largest where the name says worst."""
    found = np.array([r[field] for r in rows], float)
    return float(np.nanmax(found) if 'worst' in name else np.nanmean(found))


def restorations(finish: str, on: str, before: str) -> None:
    """before: what the names of the figures begin with."""
    names = OF_MACHINED if finish == 'machined' else OF_LAID
    closed, opened = (list(jobs(finish, on, loop)) for loop in (CLOSED, OPEN))
    print(f'{finish}, {on}: {", ".join(names)}; in brackets open loop', file=sys.stderr)
    for kind in kinds():
        some = [[r for k, r in rows if k == kind] for rows in (closed, opened)]
        said = [
            f'{mean(some[0], n, f):.2f} ({mean(some[1], n, f):.2f})' for n, (f, _) in names.items()
        ]
        print(f'| {kind} | {" | ".join(said)} |', file=sys.stderr)
    rows, base = ([r for _, r in found] for found in (closed, opened))
    for name, (field, unit) in names.items():
        emit(f'{before}{name}', mean(rows, name, field), unit, OPEN, mean(base, name, field), on)
    if finish == 'machined':
        bad = {k for k, r in closed if not r['good']}
        told = {k for k, r in closed if r['told']}
        good = set(kinds()) - bad
        if bad:
            emit(f'{before}plan_told_share', len(bad & told) / len(bad), '', 'wanted', 0.9, on)
        if good:
            emit(f'{before}plan_false_alarms', len(good & told) / len(good), '', 'wanted', 0.1, on)


machined = partial(restorations, 'machined', 'recorded', 'shop.')
gentle = partial(restorations, 'as-laid', 'gentle', 'shop.')
recorded = partial(restorations, 'as-laid', 'recorded', 'shop.recorded_')
FIGURES = {
    **{f'shop.{name}': machined for name in (*OF_MACHINED, 'plan_told_share', 'plan_false_alarms')},
    **{f'shop.{name}': gentle for name in OF_LAID},
    **{f'shop.recorded_{name}': recorded for name in OF_LAID},
}
