"""`waam replay`: compute a recorded job again, offline with other parameters, or play it to the nodes of a graph."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_node.files import write_atomically
from waam_node.job_folder import is_record, record_folders

if TYPE_CHECKING:
    from .tune import Tuning

_EXAMPLES = """examples:
  waam replay check jobs/latest                        is everything what it was, to the last bit?
  waam replay tune jobs/latest --set correction_server.k_gain=0.2
  waam replay tune jobs/latest --set scan_fusion.height_max=0.4 --set correction_server.law=proportional
  waam replay tune jobs/latest --set job.heat_factor=0.95     what the job asked for can be changed too
  waam replay check jobs                               every record in a folder
  waam replay play jobs/latest --rate 4 --topics /telemetry /height_map

Every layer starts from the surface that was really measured: `tune` shows what other parameters would have
commanded on it. What would come of it: `waam lab fit`, then `waam lab`."""

PLAY: dict[str, dict[str, Any]] = {
    'rate': {'type': float, 'default': 1.0, 'help': 'recorded seconds per second (default 1)'},
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
    text = 'offline, with other parameters; table, and JSON beside the job'
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
    text = (
        'job folder or its record folder; several, or a folder of job folders, one after the other'
    )
    p.add_argument('jobs', type=Path, nargs='+', metavar='JOB', help=text)
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
    from .summary import as_json

    try:
        if is_many(args.jobs):
            return _many(args, 'tune', args.settings)
        (job,) = args.jobs
        result = _tuned(job, args.settings)
        folder = args.output or job / 'replay'
        folder.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as e:
        return _error(e)
    _print(result)
    (folder / 'tune.json').write_text(json.dumps(as_json(result), indent=1), encoding='utf-8')
    print(f'written: {folder / "tune.json"}')
    return 0


def _check(args: argparse.Namespace) -> int:
    try:
        if is_many(args.jobs):
            return _many(args, 'check', [])
        result = _tuned(args.jobs[0], [])
    except (ValueError, OSError) as e:
        return _error(e)
    _print(result)
    print('identical to the record' if result.same else 'DIFFERENT from the record')
    return 0 if result.same else 1


def _is_job(path: Path) -> bool:
    """Whether a folder is a job folder with a record, or a record folder itself."""
    if not path.is_dir():
        return False
    return bool(is_record(path.name) or record_folders(path) or list(path.glob('*.mcap')))


def is_many(jobs: list[Path]) -> bool:
    """Whether more than one record is meant."""
    return len(jobs) > 1 or (jobs[0].is_dir() and not _is_job(jobs[0]))


def jobs_in(paths: list[Path]) -> list[Path]:
    """Job folders with a record, in `paths` and in folders of job folders. ValueError when there is none."""
    found: list[Path] = []
    for path in paths:
        if _is_job(path) or not path.is_dir():
            found.append(path)  # what is wrong with it is said when it is read
        else:
            found += [p for p in sorted(path.iterdir()) if _is_job(p) and not p.is_symlink()]
    if not found:
        raise ValueError(f'no recorded job in {", ".join(map(str, paths))}')
    return list(dict.fromkeys(f.resolve() for f in found))


def _many(args: argparse.Namespace, verb: str, settings: list[str]) -> int:
    """A line per record and a file with all results; 1 when a record cannot be read or, for check, differs."""
    from .parameters import effective
    from .summary import as_json
    from .tune import tune

    effective({}, settings)  # a misspelt name is found before anything is read
    found: dict[str, dict[str, Any]] = {}
    for job in jobs_in(args.jobs):
        try:
            result = tune(job, settings)
            found[str(job)] = {**as_json(result), 'same': result.same}
            said = 'identical' if result.same else 'different'
        except Exception as e:  # a record that no check has foreseen does not end the others
            said = f'error: {" ".join(str(e).split()) or type(e).__name__}'
            found[str(job)] = {'error': said}
        print(f'{job.name}: {said}', flush=True)
    out = args.output or Path(os.environ.get('WAAM_JOBS', 'jobs')) / f'replay_{verb}'
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / f'{verb}.json', json.dumps(found, indent=1))
    errors = sum('error' in f for f in found.values())
    same = sum(bool(f.get('same')) for f in found.values())
    other = len(found) - same - errors
    print(f'{len(found)} records: {same} identical, {other} different, {errors} errors')
    print(f'written: {out / f"{verb}.json"}')
    return 1 if errors or (verb == 'check' and other) else 0


def _print(result: Tuning) -> None:
    from rich.console import Console

    from .summary import tables

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
