"""Programs of others.

program.path_um: largest distance of the path that a job lays from the path of LinuxCNC's rs274, over files of
PrusaSlicer, Slic3r and Cura, programs of `waam plan` (plain and with arcs) and 300 random ones with lines, arcs,
helices, planes, units and shifts; baseline: the tolerance that was asked for. Without rs274 (package linuxcnc-uspace)
the arcs are judged by an evaluation of their own, and the line says so. `WAAM_PROGRAMS=FOLDER` adds the programs
(*.gcode) of a folder, for the files of other slicers, which may not lie here; NAME.yaml beside one is its dialect
(`slicer` without).
program.rms_ratio: RMS height error of a block of PrusaSlicer (eight layers in 52 x 32 mm, concentric, nominal part
48 x 28 mm: 2 mm of allowance on the sides), closed loop over open loop, mean of five seeds in the laboratory; baseline:
asked for. `WAAM_BENCH_SEEDS=1,2` chooses the seeds; a seed takes about a minute of a core.
"""

from __future__ import annotations

import math
import os
import random
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lib.emit import emit
from lib.preset import emit_on_cell, preset
from lib.rs274 import available, exact_off_um, off_um
from lib.seeds import seeds

if TYPE_CHECKING:
    import numpy as np

    from waam_lab.job import LabJob

ROOT = Path(__file__).resolve().parents[1]
SLICED = ROOT / 'waam_ws/src/waam_plan/test/programs'
BLOCK = Path(__file__).with_name('programs') / 'prusaslicer_block.gcode'
WANTED_UM, WANTED_RATIO = 1.0, 0.25
RANDOM = 300
SEEDS = (1, 2, 3, 4, 5)


def random_program(rng: random.Random) -> str:
    """Lit moves of all kinds, words of four decimals."""
    out = ['G21 G90 G17', 'G0 Z5', 'G0 X0 Y0', 'G1 Z0 F600', 'W6000 S22', 'M3']
    for _ in range(rng.randint(2, 12)):
        radius, turn = rng.uniform(0.5, 80), rng.uniform(0.1, 6.1)
        word, sign = rng.choice((('G3', 1), ('G2', -1)))
        x, y = (radius * f(sign * turn) for f in (math.cos, math.sin))
        i, z = -radius, rng.uniform(-3, 3)
        plane = rng.choice(
            (
                f'G17 {word} X{x - radius:.4f} Y{y:.4f} Z{z:.4f} I{i:.4f}',
                f'G18 {word} Z{x - radius:.4f} X{y:.4f} Y{z:.4f} K{i:.4f}',
                f'G19 {word} Y{x - radius:.4f} Z{y:.4f} X{z:.4f} J{i:.4f}',
                f'G17 {word} X{rng.uniform(1, 9):.4f} R{rng.uniform(5.1, 30):.4f}',
            )
        )
        out.append(f'G91 {plane}')
        out.append(f'G90 G1 X{rng.uniform(-90, 90):.4f} Y{rng.uniform(-90, 90):.4f} Z0')
    return '\n'.join([*out, 'M5'])


def own_programs() -> list[str]:
    """A ring of our planner, plain and compact."""
    import trimesh

    from waam_plan.gcode.program import compact_gcode, gcode
    from waam_plan.layers.build import plan_build
    from waam_plan.mesh.part import load_part
    from waam_plan.settings import PlanSettings

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        path = Path(scratch) / 'ring.stl'
        trimesh.creation.annulus(r_min=20, r_max=34, height=4, sections=180).export(path)
        plan = plan_build(load_part(path), PlanSettings(strategy='contour'))
    return [gcode(plan), compact_gcode(plan)[0]]


def others() -> list[tuple[str, str, str]]:
    """Name, text and dialect of the programs in the folder that `WAAM_PROGRAMS` names."""
    from waam_plan.import_gcode.files import program_text

    if not (folder := os.environ.get('WAAM_PROGRAMS')):
        print(
            'program.path_um: files of more slicers are left out: WAAM_PROGRAMS names no folder',
            file=sys.stderr,
        )
        return []
    files = sorted(Path(folder).glob('*.gcode'))
    if not files:
        raise SystemExit(f'WAAM_PROGRAMS={folder}: no *.gcode in it')
    dialects = [f.with_suffix('.yaml') for f in files]
    return [
        (f.name, program_text(f), str(d) if d.exists() else 'slicer')
        for f, d in zip(files, dialects, strict=True)
    ]


def path() -> None:
    """Each program by name on stderr."""
    rng = random.Random(1)
    programs = [(f.name, f.read_text(), 'slicer') for f in sorted(SLICED.glob('*.gcode'))]
    programs += [('our own', text, 'waam') for text in own_programs()]
    programs += others()
    programs += [('random', random_program(rng), 'waam') for _ in range(RANDOM)]
    judge = off_um if available() else exact_off_um
    worst, count = {}, 0
    for name, text, dialect in programs:
        off, moves = judge(text, dialect)
        worst[name], count = max(worst.get(name, 0.0), off), count + moves
    for name, off in worst.items():
        print(f'program.path_um: {name}: {off:.3f} um', file=sys.stderr)
    by = 'rs274' if available() else 'an evaluation of its own: rs274 is not installed'
    print(f'program.path_um: {count} moves, judged by {by}', file=sys.stderr)
    emit('program.path_um', max(worst.values()), 'um', f'asked for, judged by {by}', WANTED_UM)


@contextmanager
def block_job(loop_mode: str) -> Iterator[LabJob]:
    """The block of PrusaSlicer in the laboratory."""
    import trimesh

    from waam_job.model.goal import JobGoal
    from waam_lab.job import LabJob

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        part = Path(scratch) / 'block.stl'
        trimesh.creation.box(extents=(48, 28, 16)).export(part)
        goal = JobGoal(
            part=part,
            material='er70s-6',
            jobs_dir=Path(scratch),
            mode='build',
            loop_mode=loop_mode,
            program=BLOCK,
            dialect='slicer',
        )
        yield LabJob(goal, preset=preset())


def block_rms(loop_mode: str, figure: str) -> np.ndarray:
    """(seeds,) m; also told on stderr."""
    import numpy as np

    from waam_lab import over_seeds, run_many

    wanted = seeds(SEEDS)
    with block_job(loop_mode) as job:
        found = run_many(over_seeds(job, list(wanted)), workers=1)
    rms = np.array([r.rms for r in found])
    told = ' '.join(f'{v * 1e3:.3f}' for v in rms)
    print(f'{figure}: {loop_mode}, seeds {wanted}: {told} mm', file=sys.stderr)
    return rms


def ratio() -> None:
    """Both loop modes on the same cells."""
    name = 'program.rms_ratio'
    before, after = (block_rms(mode, name) for mode in ('open_loop', 'closed_loop'))
    emit_on_cell(name, float(after.mean() / before.mean()), '1', 'asked for', WANTED_RATIO)


FIGURES = {
    'program.path_um': path,
    'program.rms_ratio': ratio,
}
