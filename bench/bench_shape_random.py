"""Parts of random shape, size and wear (`waam_lab.parts.random_part`), restored in the laboratory with the defaults.

`shape.chosen_rms_mm`: mean RMS with the layout that `waam lab --choose` takes, against the default layout on the same
cells; chosen on cells of other physics, reported on the usual ones (seeds 1 and 2).
`shape.unseen_rms_mm`, `shape.unseen_worst_mm`: mean and worst RMS of twenty parts that nothing was chosen on, seed 1;
baseline: law `damped_inverse`.

`WAAM_BENCH_SEEDS`, `WAAM_BENCH_WORKERS` as in bench_shape.py. A job takes 3 to 10 s.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_shape import FIRST, done, told, workers
from lib.adapt_stats import interval
from lib.preset import emit_on_cell as emit
from lib.preset import preset
from lib.seeds import seeds

RANDOM_PARTS = (21, 22, 23, 24, 25, 26)
UNSEEN = tuple(range(61, 81))
LAWS = ('unet', 'damped_inverse')


def random_part(folder: Path, number: int) -> tuple[Path, Path]:
    """Nominal and worn mesh of waam_lab.parts.random_part."""
    from waam_lab import parts

    nominal, worn = parts.random_part(np.random.default_rng(number)).meshes()
    assert worn is not None
    paths = folder / f'{number}_nominal.stl', folder / f'{number}_worn.stl'
    for mesh, path in zip((nominal, worn), paths, strict=True):
        mesh.export(path)
    return paths


def chosen() -> None:
    from waam_lab import layouts, over_seeds, restore, run_many
    from waam_lab.cli_choose import choose

    usual, taken = [], []
    for number in RANDOM_PARTS:
        with tempfile.TemporaryDirectory() as folder:
            job = restore(*random_part(Path(folder), number), tolerance=0.2e-3, preset=preset())
            layout = layouts.best(choose(job, 2, workers())).layout
            of_layout = layouts.laid(job, layout)
            jobs = over_seeds(job, seeds(FIRST)) + over_seeds(of_layout, seeds(FIRST))
            found = done(run_many(jobs, workers=workers()))
        half = len(found) // 2
        told(f'random part {number}, as asked', found[:half])
        told(f'random part {number}, {layout.name}', found[half:])
        usual.append(np.mean([r.rms for r in found[:half]]))
        taken.append(np.mean([r.rms for r in found[half:]]))
    _, low, high = interval(np.array(taken) / np.array(usual))
    print(f'ratio over parts: 95 % interval {low:.3f} .. {high:.3f}', file=sys.stderr)
    best, asked = 1e3 * float(np.mean(taken)), 1e3 * float(np.mean(usual))
    emit('shape.chosen_rms_mm', best, 'mm', 'the default layout', asked)


def unseen() -> None:
    from waam_lab import over_seeds, restore, run_many

    some, jobs = seeds((1,)), []
    with tempfile.TemporaryDirectory() as folder:
        for number in UNSEEN:
            job = restore(*random_part(Path(folder), number), tolerance=0.2e-3, preset=preset())
            for law in LAWS:
                overrides = {'correction_server': {'law': law}}
                jobs += over_seeds(replace(job, overrides=overrides), some)
        found = done(run_many(jobs, workers=workers()))
    rms = 1e3 * np.array([r.rms for r in found]).reshape(len(UNSEEN), len(LAWS), len(some))
    for number, (own, explicit) in zip(UNSEEN, rms.mean(axis=2), strict=True):
        print(f'random part {number}: {own:.4f}, {LAWS[1]} {explicit:.4f} mm', file=sys.stderr)
    for law in LAWS:
        told(law, [r for job, r in zip(jobs, found, strict=True) if law in str(job.overrides)])
    for name, value in (('rms', rms.mean(axis=(0, 2))), ('worst', rms.max(axis=(0, 2)))):
        emit(f'shape.unseen_{name}_mm', float(value[0]), 'mm', f'law {LAWS[1]}', float(value[1]))


FIGURES = {
    'shape.chosen_rms_mm': chosen,
    'shape.unseen_rms_mm': unseen,
    'shape.unseen_worst_mm': unseen,
}
