"""Layers of random parts on random cells of all metal models and presets, to train the U-Net on.

    python3 -m waam_lab.training_data FOLDER --seeds 2000-2199

Writes one job_<seed>.npz per seed (waam_train.samples); seeds that are there already are left out, so it can
be stopped and taken up again. --workers: processes. A job takes 2 to 20 s.
`waam train FOLDER` trains on them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from waam_node.advance import Advance
from waam_node.spread import Workers, add_options, spread
from waam_train import samples

from .cli_campaign import parse_seeds
from .job import LabJob, build, restore
from .laboratory import run
from .parts import random_build, random_part, random_wall
from .plants import training_plant
from .watch import LayerWatch

PRELOAD = ('waam_lab.laboratory',)
KINDS = {'part': 0.65, 'wall': 0.15, 'build': 0.2}
# of restored parts; walls and builds are laid as the planner chooses
STRATEGIES = {'solid': 0.55, 'contour': 0.13, 'zigzag': 0.14, 'spiral': 0.1, 'combined': 0.08}
PRESET_SHARES = {'gentle': 0.25, 'recorded': 0.5, 'rough': 0.25}
FINISH = 1e-3  # m, of the finishing layers of three jobs in four
FINISHES = (0.8e-3, 1.6e-3)  # m, of the others
Piece = tuple[Path, int, str, str]  # folder, seed, law and its weights


def kind_of(seed: int) -> str:
    """What the job of a seed lays: one of KINDS."""
    return str(np.random.default_rng(seed).choice(list(KINDS), p=list(KINDS.values())))


def random_job(folder: Path, seed: int, law: str = 'bead_solver', model: str = '') -> LabJob:
    """A restoration or build of a random part on a cell of random physics, by default with the bead model alone; meshes
    go to the folder. model: file of weights, '' = the packaged ones."""
    rng = np.random.default_rng((seed, 1))
    kind = kind_of(seed)
    shape = {'part': random_part, 'wall': random_wall, 'build': random_build}[kind](rng)
    nominal, worn = shape.meshes()
    part, as_found = folder / f'{seed}_nominal.stl', folder / f'{seed}_worn.stl'
    nominal.export(part)
    if worn is not None:
        worn.export(as_found)
    strategy = str(rng.choice(list(STRATEGIES), p=list(STRATEGIES.values())))
    finish = FINISH if rng.random() < 0.75 else float(rng.uniform(*FINISHES))
    preset = str(rng.choice(list(PRESET_SHARES), p=list(PRESET_SHARES.values())))
    options: dict[str, Any] = {
        'seed': seed,
        'preset': preset,
        'tolerance': 0.2e-3,
        'plan_settings': (f'finish_height={finish:.5f}',),
        'plant': training_plant(rng, preset),
        'overrides': {'correction_server': {'law': law, 'model': model}},
    }
    if worn is None:
        return build(part, **options)
    chosen = strategy if kind == 'part' else ''
    return restore(part, as_found, strategy=chosen, **options)


def make(folder: Path, seed: int, law: str = 'bead_solver', model: str = '') -> int:
    """Runs one job and writes its layers; returns how many."""
    watch = LayerWatch()
    with tempfile.TemporaryDirectory() as scratch:
        job = random_job(Path(scratch), seed, law, model)
        run(job, watch=watch)
    family = job.plant.metal.model if job.plant is not None else ''
    layers = watch.samples(seed, family)
    samples.save(folder, seed, layers)
    return len(layers)


def main(argv: list[str] | None = None) -> int:
    """Exit status: 1 when a part could not be planned; the other seeds are made all the same."""
    p = argparse.ArgumentParser(
        prog='python3 -m waam_lab.training_data', description=(__doc__ or '').split('\n')[0]
    )
    p.add_argument('folder', type=Path)
    p.add_argument(
        '--seeds', default='2000-2199', help='such as 2000-2199 (default) or 7,9; N: 1 to N'
    )
    p.add_argument(
        '--law',
        choices=('bead_solver', 'unet'),
        default='bead_solver',
        help='unet: for a further round, laid with the weights of the one before (default: bead_solver)',
    )
    p.add_argument('--model', default='', help='weights of law unet (default: the packaged ones)')
    add_options(p)
    args = p.parse_args(argv)
    folder = args.folder.resolve()
    model = str(Path(args.model).resolve()) if args.model else ''
    left = {s: (folder, s, args.law, model) for s in parse_seeds(args.seeds)}
    left = {s: piece for s, piece in left.items() if not (folder / f'job_{s}.npz').exists()}
    workers, failures = Workers(args.workers, PRELOAD), 0
    with Advance(len(left), 'training data') as bar:
        try:
            for seed, made in spread(left, attempt, lost, workers):
                failures += isinstance(made, str)
                bar.step(f'seed {seed}: {made if isinstance(made, str) else f"{made} layers"}')
        except KeyboardInterrupt:
            print(
                f'{bar.done} of {len(left)} seeds are done; the same command goes on',
                file=sys.stderr,
            )
            return 130
    return 1 if failures else 0


def attempt(piece: Piece) -> int | str:
    """One seed in a worker: its layers, or why there are none."""
    try:
        return make(*piece)
    except ValueError as e:  # a part that cannot be planned
        return str(e)


def lost(_piece: Piece, error: Exception) -> int | str:
    """The worker of a seed was lost again and again."""
    return f'not made: {error}'


if __name__ == '__main__':
    sys.exit(main())
