"""Worn shafts restored as they turn, in the laboratory: preset `recorded`, open loop beside it.

Shafts of 40, 80 and 200 mm, worn 1 to 4 mm (eccentric, oval, scored, tapered), run-out up to 1 mm; their axis and the
place of the wear around them belong to the seed. Finish `as-laid`: `round.rms_mm` (mean) and `round.rms_worst_mm` of
the radial error, baseline open loop; `round.seam_mm`, the largest step across the seam of the map; `round.runout_mm`,
the largest error of the axis that was found, in the middle of the shaft. Finish `machined`: `round.cleans_up_share` and
`round.stock_mean_mm`, radial. `round.plan_seconds`: the plan of a shaft of 200 x 200 mm with at least six layers.

One line per job on stderr. `WAAM_BENCH_SEEDS=1,2` chooses seeds, `WAAM_BENCH_KIND=40,200` diameters in mm,
`WAAM_BENCH_WORKERS` the number of processes (2).
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.seeds import seeds

ON, CLOSED, OPEN = 'recorded', 'closed_loop', 'open_loop'
SEEDS = (1,)
SHAFTS = (  # diameter, length, ends, m; wear, depth m
    (0.040, 0.060, 0.014, 'eccentric', 1.5e-3),
    (0.040, 0.060, 0.014, 'oval', 2.5e-3),
    (0.080, 0.070, 0.016, 'tapered', 2.0e-3),
    (0.080, 0.070, 0.016, 'scored', 1.2e-3),
    (0.200, 0.060, 0.014, 'eccentric', 4.0e-3),
)
PLANNED = (0.200, 0.200, 0.020, 'eccentric', 12e-3)
MOST_RUN_OUT = 0.5e-3  # m of eccentricity: 1 mm as a dial gauge reads it


def worn(shaft: tuple, seed: int):
    """The shaft as it is found with this seed."""
    from waam_lab.shafts import WornShaft

    rng = np.random.default_rng([seed, int(shaft[0] * 1e3), int(shaft[4] * 1e5)])
    size, towards, turned = rng.uniform(0, MOST_RUN_OUT), *rng.uniform(0, 2 * np.pi, 2)
    centre = (size * float(np.cos(towards)), size * float(np.sin(towards)))
    return WornShaft(*shaft, run_out=centre, tilt=(1e-3, -1e-3), turned=float(turned))


@lru_cache
def results(finish: str, loop: str) -> list[tuple[tuple[float, float], object]]:
    """True axis and result of every job."""
    from waam_lab import restore_shaft, run_many

    named = os.environ.get('WAAM_BENCH_KIND', '')
    chosen = [s for s in SHAFTS if not named or f'{s[0] * 1e3:g}' in named.split(',')]
    jobs, axes = [], []
    with tempfile.TemporaryDirectory() as folder:
        for number, shaft in enumerate(chosen):
            for seed in seeds(SEEDS):
                part = worn(shaft, seed)
                scan = Path(folder) / f'{shaft[3]}_{shaft[0] * 1e3:g}_{number}_{seed}.npz'
                part.map().save_npz(scan)
                told = {'preset': ON, 'loop_mode': loop, 'plan_settings': (f'finish={finish}',)}
                jobs.append(restore_shaft(scan, part.diameter, part.ends, seed, **told))
                axes.append(part.run_out)
        found = run_many(jobs, workers=int(os.environ.get('WAAM_BENCH_WORKERS', '2')))
    for job, r in zip(jobs, found, strict=True):
        said = r.message if r.failed else (
            f'RMS {r.rms * 1e3:.3f} mm, seam {r.seam_step * 1e3:+.3f} mm, roundness {r.roundness * 1e3:.3f} mm, '
            f'run-out {r.new_run_out * 1e3:.3f} mm, clean {r.clean_share:.2%}, stock {r.stock_mean * 1e3:.2f} mm, '
            f'diameter {r.clean_diameter * 1e3:.2f} mm, {r.layers} layers, {r.cpu:.0f} s'
        )  # fmt: skip
        print(
            f'{job.goal.title}, seed {r.seed}, {finish}, {loop}: {said}',
            file=sys.stderr,
            flush=True,
        )
    return list(zip(axes, found, strict=True))


def ended(finish: str, loop: str) -> list:
    """Results of the jobs that came to their end, with their true axis."""
    return [(axis, r) for axis, r in results(finish, loop) if not r.failed]


def laid() -> None:
    closed, opened = ended('as-laid', CLOSED), ended('as-laid', OPEN)
    errors, base = ([r.rms * 1e3 for _, r in some] for some in (closed, opened))
    told = partial(emit, preset=ON)
    told('round.rms_mm', float(np.mean(errors)), 'mm', OPEN, float(np.mean(base)))
    told('round.rms_worst_mm', max(errors), 'mm', OPEN, max(base))
    seam = max(abs(r.seam_step) * 1e3 for _, r in closed)
    told('round.seam_mm', seam, 'mm', OPEN, max(abs(r.seam_step) * 1e3 for _, r in opened))
    axis = max(float(np.hypot(*np.subtract(r.axis, true))) * 1e3 for true, r in closed)
    told('round.runout_mm', axis, 'mm', 'wanted', 0.02)


def machined() -> None:
    """A job that fails does not clean up."""
    shares, stocks = [], []
    for loop in (CLOSED, OPEN):
        rows = results('machined', loop)
        shares.append(sum(r.in_tolerance for _, r in rows) / len(rows))
        stocks.append(float(np.mean([r.stock_mean * 1e3 for _, r in rows if not r.failed])))
    emit('round.cleans_up_share', shares[0], '', OPEN, shares[1], ON)
    emit('round.stock_mean_mm', stocks[0], 'mm', OPEN, stocks[1], ON)


def plan_seconds() -> None:
    from waam_plan.layers.restore import plan_restoration
    from waam_plan.settings import PlanSettings
    from waam_plan.shaft.surfaces import of_file

    part = worn(PLANNED, 1)
    far = {'machine_min': (-5.0, -0.1, -0.1), 'machine_max': (5.0, 0.4, 0.4)}
    settings = PlanSettings(
        shaft_diameter=part.diameter, shaft_ends=part.ends, tolerance=0.2e-3, **far
    )
    with tempfile.TemporaryDirectory() as folder:
        scan = Path(folder) / 'worn.npz'
        part.map().save_npz(scan)
        began = time.monotonic()
        found, nominal, _ = of_file(scan, 1e-3, settings)
        plan = plan_restoration(found, nominal, settings)
        took = time.monotonic() - began
    print(f'{len(plan.layers)} layers, {plan.beads} beads', file=sys.stderr)
    emit('round.plan_seconds', took, 's', 'wanted', 5.0)


FIGURES = {
    **{f'round.{name}': laid for name in ('rms_mm', 'rms_worst_mm', 'seam_mm', 'runout_mm')},
    **{f'round.{name}': machined for name in ('cleans_up_share', 'stock_mean_mm')},
    'round.plan_seconds': plan_seconds,
}
