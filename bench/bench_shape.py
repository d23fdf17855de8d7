"""The part that comes out: jobs of the demo's jaw in the laboratory, with the defaults, over many seeds.

One set of jobs gives `shape.in_tolerance_share`, `shape.rms_mean_mm`, `shape.rms_worst_mm`, `shape.rms_edges_mm`,
`shape.largest_mm` (99.5 % of the cells, worst seed), `shape.level_worst_mm` (mean error after layers 4 ... last, any
seed) and `shape.time_ratio`, on the preset that users get. On `gentle` they are
`shape.gentle_in_tolerance_share`, `shape.gentle_rms_mean_mm`, `shape.gentle_rms_worst_mm`, `shape.gentle_rms_edges_mm`,
`shape.gentle_largest_mm`, `shape.gentle_level_worst_mm` and `shape.gentle_time_ratio`. All but a rim of 1 mm along the
edge is judged. `shape.parts_worst_mm`: worst mean RMS of the six parts of `waam_lab.parts`. `shape.unseen_rms_mm`,
`shape.unseen_worst_mm`: mean and worst RMS of twenty parts of random shape, size and wear that nothing was chosen on
(`waam_lab.parts.random_part`, seed 1); baseline: law `damped_inverse`.

Baselines are version 0.1 on its seeds 1, 2, 3, 7 and 11 (equal layers of 2 mm, pitch 0.73), and the same jobs without
correction. Settings were chosen on seeds 101 to 106 and 201 to 206; the seeds here are for reporting only.
`WAAM_BENCH_SEEDS=1,2` chooses others, `WAAM_BENCH_WORKERS` the number of processes (2). A job takes 6 to 10 s. All but
the first figures are those of the preset `gentle`; `WAAM_BENCH_PRESET=recorded` chooses another one, for all.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from lib.jaw import jaw_job
from lib.preset import USUAL, preset
from lib.preset import emit_on_cell as emit
from lib.seeds import seeds

from waam_process.operating import DEFAULT_PRESET

SEEDS = tuple(range(1, 21))
FEW = (1, 2, 3, 4, 5)
UNSEEN = tuple(range(61, 81))  # numbers of random parts
EXPLICIT = 'damped_inverse'
OLD = 'version 0.1, gentle, five seeds'
OLD_TIME = 700.0  # s


def workers() -> int:
    return int(os.environ.get('WAAM_BENCH_WORKERS', '2'))


def done(found: list) -> list:
    """The results; RuntimeError with the message of a job that failed."""
    for result in found:
        if result.failed:
            raise RuntimeError(f'seed {result.seed}: {result.message}')
    return found


def told(name: str, found: list) -> None:
    """One line per set of jobs on stderr."""
    rms = 1e3 * np.array([r.rms for r in found])
    share = np.array([r.share_in_tolerance for r in found])
    print(
        f'{name}: RMS {rms.mean():.3f} mm ({rms.min():.3f} .. {rms.max():.3f}), within tolerance {share.mean():.1%} '
        f'({share.min():.1%} .. {share.max():.1%}), {sum(r.in_tolerance for r in found)} of {len(found)} in tolerance',
        file=sys.stderr,
    )


def jaw() -> None:
    """On the cell that users get, and on the one that settings were chosen on."""
    on = preset(DEFAULT_PRESET)
    jaw_on(on, 'shape.')
    if on != USUAL:
        jaw_on(USUAL, f'shape.{USUAL}_')


def jaw_on(on: str, name: str) -> None:
    """name: what the names of the figures begin with."""
    from waam_lab import over_seeds, run_many

    found = done(run_many(over_seeds(jaw_job(preset=on), seeds(SEEDS)), workers=workers()))
    told(f'jaw, {on}', found)
    rms, edges, largest = (
        1e3 * np.array([getattr(r, k) for r in found]) for k in ('rms', 'rms_edges', 'largest')
    )
    level = max(abs(m) for r in found for m in r.layer_means[3:])
    good = float(np.mean([r.in_tolerance for r in found]))
    time = float(np.mean([r.time for r in found]))
    for figure, value, unit, baseline, old in (
        ('in_tolerance_share', good, '', OLD, 0.0),
        ('rms_mean_mm', float(rms.mean()), 'mm', OLD, 0.192),
        ('rms_worst_mm', float(rms.max()), 'mm', OLD, 0.260),
        ('rms_edges_mm', float(edges.mean()), 'mm', OLD, 0.25),
        ('largest_mm', float(largest.max()), 'mm', OLD + ', maximum', 1.7),
        ('level_worst_mm', 1e3 * level, 'mm', OLD, 0.175),
        ('time_ratio', time / OLD_TIME, '', OLD, 1.0),
    ):
        emit(f'{name}{figure}', value, unit, baseline, old, on)


def of_parts() -> None:
    from waam_lab import over_seeds, parts, run_many

    means = {}
    for name in parts.PARTS:
        with tempfile.TemporaryDirectory() as folder:
            job = parts.job(Path(folder), name, tolerance=0.2e-3, preset=preset())
            found = done(run_many(over_seeds(job, seeds(FEW)), workers=workers()))
        told(name, found)
        means[name] = 1e3 * float(np.mean([r.rms for r in found]))
    emit('shape.parts_worst_mm', max(means.values()), 'mm', OLD + ', L, ring, cylinder', 0.37)


def unseen() -> None:
    """With the defaults, and with the explicit law on the same cells."""
    from waam_adapt.laws.corrector import CorrectionParams
    from waam_lab import over_seeds, parts, restore, run_many

    laws, some, jobs = (CorrectionParams().law, EXPLICIT), seeds((1,)), []
    with tempfile.TemporaryDirectory() as folder:
        for number in UNSEEN:
            meshes = parts.random_part(np.random.default_rng(number)).meshes()
            paths = [Path(folder) / f'{number}_{name}.stl' for name in ('nominal', 'worn')]
            for mesh, path in zip(meshes, paths, strict=True):
                mesh.export(path)
            job = restore(*paths, tolerance=0.2e-3, preset=preset())
            for law in laws:
                overrides = {'correction_server': {'law': law}}
                jobs += over_seeds(replace(job, overrides=overrides), some)
        found = done(run_many(jobs, workers=workers()))
    for law in laws:
        told(law, [r for job, r in zip(jobs, found, strict=True) if law in str(job.overrides)])
    rms = 1e3 * np.array([r.rms for r in found]).reshape(len(UNSEEN), len(laws), len(some))
    for name, value in (('rms', rms.mean(axis=(0, 2))), ('worst', rms.max(axis=(0, 2)))):
        emit(f'shape.unseen_{name}_mm', float(value[0]), 'mm', f'law {EXPLICIT}', float(value[1]))


ON_JAW = (
    'in_tolerance_share', 'rms_mean_mm', 'rms_worst_mm', 'rms_edges_mm', 'largest_mm', 'level_worst_mm', 'time_ratio',
)  # fmt: skip
FIGURES = {
    **{f'shape.{on}{name}': jaw for on in ('', 'gentle_') for name in ON_JAW},
    'shape.parts_worst_mm': of_parts, 'shape.unseen_rms_mm': unseen, 'shape.unseen_worst_mm': unseen,
}  # fmt: skip
