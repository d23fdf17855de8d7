"""waam train: trains the U-Net of law unet on layers of the laboratory."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .train import Trainer

EPILOG = """\
examples:
  python3 -m waam_lab.training_data jobs/layers --seeds 40000-40199
                                                       layers of random parts on random cells (an hour of one core)
  waam train jobs/layers --out jobs/net                a network from them (ten minutes of one core, seconds of a GPU)
      ... --resume                                     go on where it was stopped (Ctrl-C, power, ...)
  python3 -m waam_lab.training_data jobs/layers --seeds 50000-50099 --law unet --model jobs/net/unet.npz
  waam train jobs/layers --start jobs/net/unet.npz --out jobs/second
                                                       a second round: layers laid with the first network count as well
  torchrun --nproc-per-node 4 -m waam_bringup.cli train jobs/layers --out jobs/net
                                                       several processes, gradients averaged, each on a GPU of its own
                                                       where there are some

--out gets unet.npz (no pickle), a model card (unet.md), curves.png and checkpoint.npz. Use the weights with the
parameter  model: FILE  of correction_server. The same seed, settings and torch on the same machine give the same
weights, resumed or not; GPUs may differ in the last bit.
"""


def register(commands: Any) -> None:
    """Adds the verb to argparse sub-parsers."""
    p = commands.add_parser(
        'train',
        help='train the correction network on layers of the laboratory',
        description='Train the U-Net of law unet on layers of python3 -m waam_lab.training_data.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _arguments(p)
    p.set_defaults(run_command=run)


def _arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument('data', type=Path, metavar='DATA', help='folder of waam_lab.training_data')
    p.add_argument('--out', type=Path, required=True, metavar='FOLDER')
    p.add_argument('--steps', type=int, help='steps in all (default 2500)')
    p.add_argument('--batch', type=int, default=8, help='layers per step and process (default 8)')
    p.add_argument('--seed', type=int, default=1)
    p.add_argument(
        '--check-every',
        type=int,
        metavar='STEPS',
        help='validation and checkpoint (default 250)',
    )
    p.add_argument('--resume', action='store_true', help='go on from the checkpoint in --out')
    p.add_argument(
        '--device',
        default='auto',
        metavar='NAME',
        help='auto (default) = a GPU where there is one; cpu, cuda, cuda:1',
    )
    p.add_argument(
        '--widths',
        type=int,
        nargs=3,
        metavar='CHANNELS',
        help='of the three levels of the network (default 12 20 32)',
    )
    p.add_argument('--start', type=Path, metavar='NPZ', help='weights to begin with')


def run(args: argparse.Namespace) -> int:
    """Exit status: 0, or 1 with the reason on stderr. Under `torchrun` the processes train one network together."""
    try:
        import torch
    except ModuleNotFoundError:
        print('waam train needs torch: pip install -r requirements-train.txt', file=sys.stderr)
        return 1
    torch.set_num_threads(1)  # the same sums on every machine; processes are for speed
    # as cuBLAS wants it, before its first use
    os.environ.setdefault('CUBLAS_WORKSPACE_CONFIG', ':4096:8')
    torch.use_deterministic_algorithms(True)
    several = 'RANK' in os.environ and 'WORLD_SIZE' in os.environ
    if several:
        # gradients are averaged where they are: gloo for those in memory, nccl for those on GPUs
        nccl = torch.cuda.is_available() and torch.distributed.is_nccl_available()
        torch.distributed.init_process_group('cpu:gloo,cuda:nccl' if nccl else 'gloo')
    try:
        return _train(args)
    except (ValueError, OSError) as e:
        print(f'waam train: {e}', file=sys.stderr)
        return 1
    finally:
        if several:
            torch.distributed.destroy_process_group()


def _train(args: argparse.Namespace) -> int:
    from waam_adapt.laws import net_file

    from . import loop, samples, train

    where = loop.device(args.device)
    layers = list(samples.load(args.data))
    default = train.Settings()
    settings = train.Settings(
        steps=args.steps or default.steps, seed=args.seed, batch=args.batch,
        widths=tuple(args.widths) if args.widths else default.widths,
        check_every=args.check_every or default.check_every,
    )  # fmt: skip
    start = net_file.load(args.start).weights if args.start else None
    trainer = train.Trainer(layers, settings, start, where)
    _begin(trainer, args)
    if trainer.rank == 0:
        print(f'{len(layers)} layers, {loop.processes()} process(es) on {where.type}')
    with _bar(trainer) as tick:
        metrics = train.train(trainer, args.out, tick)
    if trainer.rank == 0:
        out = args.out / 'unet.npz'
        code = train.export(trainer, layers, metrics, out)
        print(
            f'{out}: tells {metrics["explained"]:.0%} of what is left of held-out layers; sha256 {code[:12]}; '
            f'curves in {out.with_name("curves.png")}'
        )
    return 0


def _begin(trainer: Trainer, args: argparse.Namespace) -> None:
    """From the checkpoint with --resume; TrainingError where another training would be overwritten."""
    from .loop import TrainingError

    checkpoint = args.out / 'checkpoint.npz'
    if args.resume:
        trainer.resume(checkpoint)
    elif checkpoint.exists():
        raise TrainingError(
            f'{checkpoint} exists: --resume goes on with it, or name another folder'
        )


@contextmanager
def _bar(trainer: Trainer) -> Iterator[Callable[[Trainer], None]]:
    """Progress bar of rank 0 with the loss and the variance that the newest validation explained."""
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
    with Progress(*columns, disable=trainer.rank != 0) as bar:
        p = trainer.progress
        task = bar.add_task('', total=trainer.settings.steps, completed=p.step, note='')

        def tick(_: Trainer) -> None:
            note = f'loss {sum(p.loss[-20:]) / len(p.loss[-20:]):.3f}'
            if p.checks:
                note += f', explained {p.checks[-1]["explained"]:.3f}'
            bar.update(task, completed=p.step, note=note)

        yield tick
