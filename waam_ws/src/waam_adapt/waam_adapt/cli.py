"""waam train: trains the correction network."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from .training.train import Trainer

ReadRequests = Callable[
    [Path], Sequence[Any]
]  # requests of correction_server/compute in a job folder

EPILOG = """\
examples:
  waam train --out jobs/net                            the packaged network again (a few minutes of one core)
  waam train --out jobs/net --steps 100                a first look
  waam train --out jobs/net --resume                   go on where it was stopped (Ctrl-C, power, ...)
  waam train --out jobs/mine --from jobs/A jobs/B      fine-tune the packaged network, half of the scenes start from
                                                       the recorded surfaces of these jobs
  python3 -m waam_lab.growth_data jobs/layers --seeds 20000-20816
  waam train --growth jobs/layers --out jobs/growth    a growth network from these layers (2 hours of one core to make
                                                       them, half an hour of one core or 40 s of a GPU to train)
      ... --steps 21000 --batch 16                     as the packaged one (5 minutes of a GPU)
  python3 -m waam_lab.growth_data jobs/laid --seeds 30000-30119 --law growth_net --model jobs/growth/growth.npz
  waam train --residual jobs/laid --start jobs/growth/growth.npz --out jobs/residual
                                                       what the loop leaves with these weights is told by a regression
                                                       in the file (seconds)
  torchrun --nproc-per-node 4 -m waam_bringup.cli train --out jobs/net      several processes, gradients averaged;
                                                       with --growth, each on a GPU of its own where there are some

--out gets correction.npz (best weights by the validation, no pickle) or growth.npz, a model card (.md), curves.png and
checkpoint.npz. Use the weights with the parameters  law: unet (or growth_net)  and  model: FILE  of correction_server.
The same seed, settings and torch on the same machine give the same weights, resumed or not; GPUs may differ in the last
bit.
"""


def register(commands: Any, read_requests: ReadRequests | None = None) -> None:
    """Adds the verb to argparse sub-parsers. read_requests: reads recorded jobs, for --from."""
    p = commands.add_parser(
        'train',
        help='train the correction network on synthetic jobs, or fine-tune it on recorded ones',
        description='Train the correction network through a differentiable model of the deposition.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _arguments(p)
    p.set_defaults(run_command=run, read_requests=read_requests)


def _arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument('--out', type=Path, required=True, metavar='FOLDER')
    p.add_argument('--steps', type=int, help='steps in all (default 400; growth network 2500)')
    p.add_argument('--batch', type=int, default=8, help='scenes per step and process (default 8)')
    p.add_argument(
        '--unroll', type=int, default=3, help='layers that gradients go through (default 3)'
    )
    p.add_argument(
        '--loss',
        choices=('height', 'imitation'),
        default='height',
        help='height: error of the surface after the layers (default); imitation: difference from '
        'the ideal control, the simpler loss of the literature, for comparison',
    )
    p.add_argument(
        '--rate', type=float, help='largest learning rate (default 0.002; growth network 0.003)'
    )
    p.add_argument('--seed', type=int, default=1)
    p.add_argument(
        '--check-every',
        type=int,
        metavar='STEPS',
        help='validation and checkpoint (default 100; growth network 250)',
    )
    p.add_argument('--threads', type=int, default=1, help='of torch in every process (default 1)')
    p.add_argument('--resume', action='store_true', help='go on from the checkpoint in --out')
    p.add_argument(
        '--from', dest='jobs', type=Path, nargs='+', default=[], metavar='JOB', help='recorded jobs'
    )
    _growth_arguments(p)


def _growth_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--device',
        default='auto',
        metavar='NAME',
        help='of the growth network: auto (default) = a GPU where there is one; cpu, cuda, cuda:1',
    )
    p.add_argument(
        '--widths',
        type=int,
        nargs=3,
        metavar='CHANNELS',
        help='of the three levels of the growth network (default 16 28 48)',
    )
    other = p.add_mutually_exclusive_group()
    other.add_argument(
        '--growth',
        type=Path,
        metavar='DATA',
        help='train the growth network instead, on layers of python3 -m waam_lab.growth_data DATA',
    )
    other.add_argument(
        '--residual',
        type=Path,
        metavar='DATA',
        help='add what the loop leaves to a growth network (--start, default: packaged), by layers of python3 -m '
        'waam_lab.growth_data DATA --law growth_net',
    )
    p.add_argument(
        '--start',
        type=Path,
        metavar='NPZ',
        help='weights to begin with (default with --from: packaged; growth network: none)',
    )


def run(args: argparse.Namespace) -> int:
    """Exit status: 0, or 1 with the reason on stderr. Under `torchrun` the processes train one network together."""
    if args.residual:
        return _add_residual(args)
    try:
        import torch
    except ModuleNotFoundError:
        print('waam train needs torch: pip install -r requirements-train.txt', file=sys.stderr)
        return 1
    torch.set_num_threads(args.threads)
    # as cuBLAS wants it, before its first use
    os.environ.setdefault('CUBLAS_WORKSPACE_CONFIG', ':4096:8')
    torch.use_deterministic_algorithms(True)
    several = 'RANK' in os.environ and 'WORLD_SIZE' in os.environ
    if several:
        # gradients are averaged where they are: gloo for those in memory, nccl for those on GPUs
        nccl = torch.cuda.is_available() and torch.distributed.is_nccl_available()
        torch.distributed.init_process_group('cpu:gloo,cuda:nccl' if nccl else 'gloo')
    try:
        return _train_growth(args) if args.growth else _train(args)
    except (ValueError, OSError) as e:
        print(f'waam train: {e}', file=sys.stderr)
        return 1
    finally:
        if several:
            torch.distributed.destroy_process_group()


def _add_residual(args: argparse.Namespace) -> int:
    """A regression, which needs no torch."""
    from .beads import plan_geometry
    from .laws import growth_law, net_file
    from .training import residual, samples

    out = args.out / 'growth.npz'
    try:
        network = net_file.load(args.start or growth_law.PACKAGED, plan_geometry.CHANNELS)
        code, explained = residual.add(network, list(samples.load(args.residual)), out)
    except (ValueError, OSError) as e:
        print(f'waam train: {e}', file=sys.stderr)
        return 1
    print(
        f'{out}: tells {explained:.0%} of what the loop leaves of held-out layers; sha256 {code[:12]}'
    )
    return 0


def _train(args: argparse.Namespace) -> int:
    if args.widths or args.device != 'auto':
        raise ValueError('--widths and --device are of the growth network, which needs --growth')
    from .laws import net_file
    from .training import recorded, train

    settings = train.Settings(
        steps=args.steps or 400, seed=args.seed, batch=args.batch, unroll=args.unroll,
        rate=args.rate or train.Settings.rate, check_every=args.check_every or train.Settings.check_every,
        loss=args.loss,
    )  # fmt: skip
    jobs = recorded.from_jobs(args.jobs, args.read_requests) if args.jobs else []
    first = args.start or (net_file.PACKAGED if jobs else None)
    trainer = train.Trainer(settings, net_file.load(first).weights if first else None, jobs)
    _begin(trainer, args)
    note = 'synthetic scenes' + (
        f' and {len(jobs)} surfaces of {len(args.jobs)} recorded jobs' if jobs else ''
    )
    with _bar(trainer, 'ratio') as tick:
        out = train.train(trainer, args.out, note, tick)
    if trainer.rank == 0:
        print(_last_words(trainer, out))
    return 0


def _train_growth(args: argparse.Namespace) -> int:
    from .beads import plan_geometry
    from .laws import net_file
    from .training import growth, loop, samples

    where = loop.device(args.device)
    layers = list(samples.load(args.growth))
    default = growth.Settings()
    settings = growth.Settings(
        steps=args.steps or default.steps, seed=args.seed, batch=args.batch, rate=args.rate or default.rate,
        widths=tuple(args.widths) if args.widths else default.widths,
        check_every=args.check_every or default.check_every,
    )  # fmt: skip
    start = net_file.load(args.start, plan_geometry.CHANNELS).weights if args.start else None
    trainer = growth.Trainer(layers, settings, start, where)
    _begin(trainer, args)
    if trainer.rank == 0:
        print(f'{len(layers)} layers, {loop.processes()} process(es) on {where.type}')
    with _bar(trainer, 'explained') as tick:
        metrics = growth.train(trainer, args.out, tick)
    if trainer.rank == 0:
        out = args.out / 'growth.npz'
        code = growth.export(trainer, layers, metrics, out)
        print(
            f'{out}: explains {metrics["explained"]:.0%} of the variance of held-out layers; sha256 {code[:12]}; '
            f'curves in {out.with_name("curves.png")}'
        )
    return 0


def _begin(trainer: Any, args: argparse.Namespace) -> None:
    """From the checkpoint with --resume; TrainingError where another training would be overwritten."""
    from .training.loop import TrainingError

    checkpoint = args.out / 'checkpoint.npz'
    if args.resume:
        trainer.resume(checkpoint)
    elif checkpoint.exists():
        raise TrainingError(
            f'{checkpoint} exists: --resume goes on with it, or name another folder'
        )


def _last_words(trainer: Trainer, out: Path) -> str:
    best = min(trainer.progress.checks, key=lambda c: c['ratio'])
    return (
        f'{out}: best at step {best["step"]}, held-out RMS {best["rms_mm"]:.3f} mm, '
        f'explicit law {best["explicit_mm"]:.3f} mm '
        f'(quotient {best["ratio"]:.3f}); curves in {out.with_name("curves.png")}'
    )


def _bar(trainer: Any, figure: str) -> AbstractContextManager[Callable[[Any], None]]:
    """Progress bar of rank 0 with the loss and one figure of the newest validation."""
    from contextlib import contextmanager

    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    @contextmanager
    def show() -> Iterator[Callable[[Any], None]]:
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

            def tick(_: Any) -> None:
                note = f'loss {sum(p.loss[-20:]) / len(p.loss[-20:]):.3f}'
                if p.checks:
                    note += f', {figure} {p.checks[-1][figure]:.3f}'
                bar.update(task, completed=p.step, note=note)

            yield tick

    return show()
