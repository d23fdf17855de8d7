"""waam train: trains the U-Net of law unet on layers of the laboratory."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from waam_process.cli_options import Verbs, add_verb

if TYPE_CHECKING:
    from .train import Trainer

EPILOG = """\
examples:
  python3 -m waam_lab.training_data jobs/layers --seeds 40000-40199
                                                       layers of random parts on random cells (an hour of one core)
  waam train jobs/layers --out jobs/net                a network from them (ten minutes of one core, seconds of a GPU)
  python3 -m waam_lab.training_data jobs/layers --seeds 50000-50099 --law unet --model jobs/net/unet.npz
  waam train jobs/layers --start jobs/net/unet.npz --out jobs/second
                                                       a second round: layers laid with the first network count as well

--out gets unet.npz (no pickle) and a model card (unet.md). Use the weights with the parameter  model: FILE  of
correction_server. The same seed, settings and torch on the same machine give the same weights; GPUs may differ in the
last bit.
"""


def register(commands: Verbs) -> None:
    """Adds the verb to argparse sub-parsers."""
    p = add_verb(
        commands, 'train', 'train the correction network on layers of the laboratory',
        ('data', Path, 'folder of waam_lab.training_data', 'DATA'), ('--out', Path, '', 'FOLDER', {'required': True}),
        ('--steps', 2500, 'default 2500'), ('--seed', 1, 'default 1'),
        ('--start', Path, 'weights to begin with', 'NPZ'),
        description='Train the U-Net of law unet on layers of python3 -m waam_lab.training_data.', epilog=EPILOG,
    )  # fmt: skip
    p.set_defaults(run_command=run)


def run(args: argparse.Namespace) -> int:
    """Exit status: 0, or 1 with the reason on stderr."""
    try:
        import torch
    except ModuleNotFoundError:
        print('waam train needs torch: pip install -r requirements-train.txt', file=sys.stderr)
        return 1
    torch.set_num_threads(1)  # the same sums on every machine
    # as cuBLAS wants it, before its first use
    os.environ.setdefault('CUBLAS_WORKSPACE_CONFIG', ':4096:8')
    torch.use_deterministic_algorithms(True)
    try:
        return _train(args)
    except (ValueError, OSError) as e:
        print(f'waam train: {e}', file=sys.stderr)
        return 1


def _train(args: argparse.Namespace) -> int:
    import torch

    from waam_adapt.laws import net_file

    from . import samples, train

    out = args.out / 'unet.npz'
    if out.exists():
        raise ValueError(f'{out} exists: name another folder')
    where = torch.device('cuda' if torch.cuda.is_available() else 'cpu')
    layers = list(samples.load(args.data))
    settings = train.Settings(steps=args.steps, seed=args.seed)
    start = net_file.load(args.start).weights if args.start else None
    trainer = train.Trainer(layers, settings, start, where)
    print(f'{len(layers)} layers, on {where.type}')
    with _bar(trainer) as tick:
        metrics = train.train(trainer, tick)
    args.out.mkdir(parents=True, exist_ok=True)
    code = train.export(trainer, layers, metrics, out)
    print(
        f'{out}: tells {metrics["explained"]:.0%} of what is left of held-out layers; sha256 {code[:12]}'
    )
    return 0


@contextmanager
def _bar(trainer: Trainer) -> Iterator[Callable[[Trainer], None]]:
    """Progress bar with the loss and the variance that the newest validation explained."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn('training'),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn('{task.fields[note]}'),
    )
    with Progress(*columns) as bar:
        p = trainer.progress
        task = bar.add_task('', total=trainer.settings.steps, note='')

        def tick(_: Trainer) -> None:
            note = f'loss {sum(p.loss[-20:]) / len(p.loss[-20:]):.3f}'
            if p.checks:
                note += f', explained {p.checks[-1]["explained"]:.3f}'
            bar.update(task, completed=p.step, note=note)

        yield tick
