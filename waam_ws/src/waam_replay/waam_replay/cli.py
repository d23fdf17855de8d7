"""`waam replay`: compute a recorded job again, offline with other parameters, or play it to the nodes of a graph."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_node.spread import add_options

if TYPE_CHECKING:
    from .tune import Tuning

_EXAMPLES = """examples:
  waam replay check jobs/latest                        is everything what it was, to the last bit?
  waam replay tune jobs/latest --set correction_server.k_gain=0.2
  waam replay tune jobs/latest --set scan_fusion.spike_factor=6 --set correction_server.law=proportional
  waam replay tune jobs/latest --set job.heat_factor=0.95     what the job asked for can be changed too
  waam replay check jobs --workers 4                   every record in a folder, on four cores
  waam replay tune jobs --set correction_server.gain=0.8 --cluster auto      on all machines of a Ray cluster
  waam replay play jobs/latest --lockstep                     the nodes themselves, on a graph of their own
  waam replay play jobs/latest --rate 4 --topics /telemetry /height_map

Every layer starts from the surface that was really measured: `tune` shows what other parameters would have
commanded on it and what that layer would have become, not a new history of the whole part.

Over many records one result per record is kept in --output. A run that was ended (Ctrl-C, power) goes on with the same
command. A worker that is lost costs its own record, which is computed again."""

PLAY: dict[str, dict[str, Any]] = {
    'rate': {'type': float, 'default': 1.0, 'help': 'recorded seconds per second (default 1)'},
    'lockstep': {'action': 'store_true',
                 'help': 'as fast as possible: wait for every map and psi of the nodes and compare it with the record'},
    'attach': {'action': 'store_true',
               'help': 'lock-step with the nodes of the running graph instead of nodes of its own'},
    'domain': {'type': int, 'help': 'lock-step: ROS_DOMAIN_ID of its nodes'},
    'topics': {'nargs': '+', 'default': [], 'metavar': 'NAME', 'help': 'only these'},
    'exclude': {'default': '', 'metavar': 'REGEX', 'help': 'not the topics it is found in'},
    'remap': {'action': 'append', 'default': [], 'metavar': 'FROM:=TO'},
    'start': {'type': float, 'default': 0.0, 'help': 's after the beginning of the record'},
    'until': {'type': float, 'default': 0.0, 'help': 's after the beginning; 0 = to the end'},
    'paused': {'action': 'store_true', 'help': 'begin paused (go on with the service player/resume)'},
    'force': {'action': 'store_true', 'help': 'also topics that command a machine'},
}  # fmt: skip


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb `replay` with its sub-verbs."""
    parser = commands.add_parser(
        'replay',
        help='compute a recorded job again, or play it to the nodes',
        description=__doc__,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest='replay_verb', required=True, metavar='VERB')
    text = 'offline, with other parameters; table, JSON and picture beside the job'
    tune = verbs.add_parser('tune', help=text, description=text)
    _add_jobs(tune)
    tune.add_argument(
        '--set', action='append', default=[], dest='settings', metavar='NODE.NAME=VALUE',
        help='parameter of scan_fusion, correction_server, feed_forward or job (repeatable)',
    )  # fmt: skip
    tune.set_defaults(run_command=_tune)
    text = (
        'offline, with the recorded parameters; exit status 1 when anything differs from the record'
    )
    check = verbs.add_parser('check', help=text, description=text)
    _add_jobs(check)
    check.set_defaults(run_command=_check)
    text = 'publish a record to a graph, with /clock; commands to the machine only with --force'
    play = verbs.add_parser('play', help=text, description=text)
    play.add_argument('job', type=Path, metavar='JOB', help='job folder or its record folder')
    for name, options in PLAY.items():
        play.add_argument(f'--{name}', **options)
    play.set_defaults(run_command=_play)


def _add_jobs(p: argparse.ArgumentParser) -> None:
    """What `check` and `tune` have in common."""
    text = 'job folder or its record folder; several, or a folder of job folders, are computed side by side'
    p.add_argument('jobs', type=Path, nargs='+', metavar='JOB', help=text)
    add_options(p)
    p.set_defaults(workers=None)  # None: one record is computed here
    text = 'folder of the results (default: JOB/replay; of many jobs: jobs/replay_check or jobs/replay_tune)'
    p.add_argument('-o', '--output', type=Path, help=text)


def _tuned(job: Path, settings: list[str]) -> Tuning:
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from .tune import tune

    columns = (SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn())
    with Progress(*columns, transient=True) as bar:
        task = bar.add_task('reading the record')
        total = 0

        def tick(n: int) -> None:
            nonlocal total
            total += n
            bar.update(task, description=f'{total} messages read, computing')

        return tune(job, settings, tick)


def _tune(args: argparse.Namespace) -> int:
    from .cli_many import is_many, run_many
    from .picture import draw
    from .summary import as_json

    try:
        if is_many(args):
            return run_many(args, 'tune')
        (job,) = args.jobs
        result = _tuned(job, args.settings)
        folder = args.output or job / 'replay'
        folder.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as e:
        return _error(e)
    _print(result)
    (folder / 'tune.json').write_text(json.dumps(as_json(result), indent=1), encoding='utf-8')
    drawn = draw(result, folder / 'tune.png')
    print(f'written: {folder / "tune.json"}' + (f', {folder / "tune.png"}' if drawn else ''))
    return 0


def _check(args: argparse.Namespace) -> int:
    from .cli_many import is_many, run_many

    try:
        if is_many(args):
            return run_many(args, 'check')
        result = _tuned(args.jobs[0], [])
    except (ValueError, OSError) as e:
        return _error(e)
    _print(result)
    same = bool(result.maps) and all(n == total for n, total in result.identical.values())
    print('identical to the record' if same else 'DIFFERENT from the record')
    return 0 if same else 1


def _print(result: Tuning) -> None:
    from rich.console import Console

    from .tables import tables

    console = Console(highlight=False)
    for table in tables(result):
        console.print(table)
    for note in (*result.parameters.notes, *result.record.damage):
        console.print(f'note: {note}')
    speed = result.machine_seconds / result.seconds if result.seconds else 0.0
    counts = ', '.join(f'{n} of {total} {name}' for name, (n, total) in result.identical.items())
    console.print(f'identical to the record: {counts}')
    console.print(
        f'{result.machine_seconds:.0f} s of machine time in {result.seconds:.2f} s ({speed:.0f} x), '
        f'digest {result.digest[:16]}'
    )


def _play(args: argparse.Namespace) -> int:
    from .play_command import play

    try:
        return play(args)
    except (ValueError, OSError) as e:
        return _error(e)


def _error(text: object) -> int:
    print(f'error: {text}', file=sys.stderr)
    return 1
