"""waam demo: the same worn part, the same seed, open loop and closed loop, and a page that compares them; then a part
that is machined afterwards, with its forecast. On the robot also closed loop on the gantry, beside it. With --part
shaft a shaft that turns in a chuck."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.table import Table

from waam_job.store.folder import make_job_id, point_latest
from waam_msgs.action import RunJob
from waam_node import job_folder
from waam_node.files import write_atomically
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.operating import DEFAULT_MATERIAL, GANTRY, ROBOT

from .cli_graph import params_files
from .cli_job import add_run_options
from .client import ClientError, GraphClient
from .graph import Settings
from .jobs import checked_of, make_goal, place_part
from .operate import default_domain, ended, graph, graph_watch
from .paths import jobs_dir, share
from .progress import JobProgress

PART, WORN = 'jaw_nominal.stl', 'jaw_worn.stl'
MACHINED = 'die_nominal.stl', 'die_worn.stl'  # nominal and worn part of the second job
SHAFT = 'shaft'  # of --part
FORECAST_CELLS = 4  # that its forecast runs on
# simulated seconds per second at most: its cell waits for the nodes, as the gantry's does
ROBOT_RATE = 10.0


def demo(args: argparse.Namespace) -> int:
    """Exit status: 0 when all jobs were done, whatever their verdict. ValueError for a missing parameter file."""
    if args.part == SHAFT and args.machine != GANTRY:
        raise ValueError(
            f'--part {SHAFT} does not go with --machine {args.machine}: only the gantry has a chuck'
        )
    return run_demo(args, params_files(args))


def run_demo(args: argparse.Namespace, params_files: tuple[Path, ...] = ()) -> int:
    """0 when all jobs were done; the verdict is in report.json and on the screen. params_files: of the nodes."""
    console = Console(stderr=True, highlight=False)
    jobs = (args.jobs or jobs_dir()).resolve()
    folder = jobs / make_job_id('demo')
    folder.mkdir(parents=True)
    started = time.monotonic()
    turns = args.part == SHAFT
    run = folder / '.run'
    what = f'{PART} ({WORN} lies on the simulated table)'
    if turns:
        from . import demo_shaft

        run.mkdir()
        params_files = (demo_shaft.chuck_params(run), *params_files)
        what = f'a worn shaft ({demo_shaft.write(folder).name} turns in the simulated chuck)'
    console.print(f'Restoring {what}, seed {args.seed}, cell {args.preset}. Starting the graph ...')
    # a demo needs no operator's page, and two cores are few
    settings = Settings(
        run=run,
        rate=args.rate or (ROBOT_RATE if args.machine == ROBOT else 0.0),
        seed=args.seed,
        without=('panel',),
        machine=args.machine,
        params_files=params_files,
        preset=args.preset,
    )
    zero = None
    with graph(settings, default_domain(folder)) as (_, client):
        results = {p: _one(client, args, folder, p, settings.run) for p in args.loop_modes}
        second = _second(client, args, folder, settings.run) if _is_whole(args) else None
        if client.machine is not None:
            offset = client.machine.work_offset
            zero = (offset.x, offset.y, offset.z)
    beside = _gantry(args, folder) if _has_gantry(args) else None
    report = combine(folder, results, args.machine, zero, beside, args.preset, second)
    point_latest(jobs, folder.name)
    page = _page(folder)
    show(report, console, time.monotonic() - started)
    if said := _outcome(report):
        print(said)
    if second is not None:
        print(_said_of(report['second'], folder))
    print(f'folder: {os.path.relpath(folder)}\nreport: {os.path.relpath(page)}')
    runs = [report[p] for p in (*args.loop_modes, 'second') if p in report]
    return 1 if any(run['error_code'] for run in runs) else 0


def _is_whole(args: argparse.Namespace) -> bool:
    """Whether this demo shows all that it has: both loop modes, all layers, the gantry."""
    both = {LoopMode.OPEN_LOOP, LoopMode.CLOSED_LOOP} <= set(args.loop_modes)
    return both and args.machine == GANTRY and args.part != SHAFT and not args.layers


def _second(client: GraphClient, args: argparse.Namespace, folder: Path, run: Path) -> Path:
    """The part that is machined afterwards: its forecast, then its job; the folder of the job."""
    parts = share('waam_bringup') / 'parts'
    nominal, worn = (parts / name for name in MACHINED)
    command = [
        *(sys.executable, '-m', 'waam_bringup.cli', 'forecast', str(nominal), '--as-found', str(worn)),
        *('--finish', 'machined', '--preset', args.preset, '--material', DEFAULT_MATERIAL),
        *('--cells', str(FORECAST_CELLS)),
    ]  # fmt: skip
    with Console(stderr=True).status(f'forecast of {MACHINED[0]}'):
        told = subprocess.run(
            command, capture_output=True, text=True, env={**os.environ, 'WAAM_JOBS': str(folder)}
        )
    if told.returncode > 1:  # refused: the job runs without it, and says so
        print(f'{MACHINED[0]}: no forecast: {told.stderr.strip()}', file=sys.stderr)
    return _one(client, args, folder, LoopMode.CLOSED_LOOP, run, 'machined', MACHINED)


def _said_of(second: dict, folder: Path) -> str:
    """Of the part that is machined afterwards: verdict, figures and where its page is."""
    page = os.path.relpath(folder / second['folder'] / job_folder.REPORT_PAGE)
    return f'{MACHINED[0]}, machined afterwards: {second["message"]}\n  its report: {page}'


def _has_gantry(args: argparse.Namespace) -> bool:
    return args.machine == ROBOT and LoopMode.CLOSED_LOOP in args.loop_modes


def _gantry(args: argparse.Namespace, folder: Path) -> Path:
    """The same part closed loop on the gantry, without what was learned: the folder of its job."""
    settings = Settings(
        run=folder / '.gantry', seed=args.seed, without=('panel',), preset=args.preset
    )
    asked = argparse.Namespace(**{**vars(args), 'fresh': True})
    with graph(settings, default_domain(folder)) as (_, client):
        return _one(client, asked, folder, LoopMode.CLOSED_LOOP, settings.run, GANTRY)


def _one(
    client: GraphClient,
    args: argparse.Namespace,
    folder: Path,
    loop_mode: str,
    run: Path,
    name: str = '',
    files: tuple[str, str] = (PART, WORN),
) -> Path:
    """A job on the worn one of `files`, or on the shaft; those of another part are laid for machining."""
    parts = share('waam_bringup') / 'parts'
    part, worn = files
    asked = [str(parts / part), *(['--finish', 'machined'] if part != PART else [])]
    if args.part == SHAFT:
        from . import demo_shaft

        asked = demo_shaft.words(folder / demo_shaft.WORN)
    words = [
        *asked, '--name', name or loop_mode, '--mode', 'restore', '--loop-mode', loop_mode,
        '--layers', str(args.layers), '--operator', 'waam demo', '--wire-lot', 'simulated', '--gas', 'simulated',
        '--material', DEFAULT_MATERIAL,
        '--note', f'seed={args.seed}', '--note', f'preset={args.preset}', *(['--fresh'] if args.fresh else []),
    ]  # fmt: skip
    options = argparse.ArgumentParser()
    add_run_options(options)
    told = options.parse_args(words)
    if args.part == SHAFT:
        place_part(client, told, checked_of(told), args.seed)
    else:
        client.load_part(str((parts / worn).resolve()), (0.0, 0.0, 0.0), args.seed)
    goal = make_goal(told, folder, folder.parent / job_folder.LEARNED_DIR)
    with JobProgress((name or loop_mode).replace('_', ' ')) as progress:
        result = client.run_job(goal, progress, graph_watch(run))
    if not result.job_dir:
        raise ClientError(f'{loop_mode}: {result.message}')
    from waam_view.report import write_report

    page = write_report(Path(result.job_dir))
    if result.error_code == RunJob.Result.ABORTED:  # whoever stops a job does not want the next one
        print(f'aborted; report: {os.path.relpath(page)}', file=sys.stderr)
        raise KeyboardInterrupt
    if result.error_code:
        gone = ended(run)
        why = '; '.join([f'error {result.error_code}: {result.message}', *gone])
        text = f'{name or loop_mode}: {why}\nreport: {os.path.relpath(page)}'
        if gone:  # what is left of the graph runs no other job
            raise ClientError(text)
        print(text, file=sys.stderr)
    return Path(result.job_dir)


def combine(
    folder: Path,
    results: dict[str, Path],
    machine: str = GANTRY,
    work_zero: tuple[float, float, float] | None = None,
    beside: Path | None = None,
    preset: str = '',
    second: Path | None = None,
) -> dict:
    """The demo's report.json: both runs, their ratio and the machine (docs/job_folder.md). work_zero: m; beside: folder
    of the closed loop on the gantry; preset: of the simulated cell; second: folder of the part that is machined."""
    runs, last = {}, {}
    for loop_mode, path in results.items():
        last = json.loads((path / job_folder.REPORT).read_text())
        runs[loop_mode] = {**last[loop_mode], 'folder': path.name, 'trace': last.get('trace')}
    report = {
        'job_id': folder.name,
        'name': 'demo',
        'part': last['part'],
        'material': last['material'],
        'created': datetime.now(UTC).isoformat(timespec='seconds'),
        'tolerance_mm': last['tolerance_mm'],
        'verdict': last['verdict'],
        'verdict_with_rim': last['verdict_with_rim'],
        'machine': machine,
        'preset': preset,
        'work_zero_m': work_zero,
        **runs,
    }
    if (
        LoopMode.OPEN_LOOP in runs
        and LoopMode.CLOSED_LOOP in runs
        and runs[LoopMode.OPEN_LOOP]['rms_mm']
    ):
        closed = runs[LoopMode.CLOSED_LOOP]['rms_mm']
        report['ratio'] = (
            closed / runs[LoopMode.OPEN_LOOP]['rms_mm'] if closed is not None else None
        )
    if beside is not None:
        run = json.loads((beside / job_folder.REPORT).read_text())[LoopMode.CLOSED_LOOP]
        report[GANTRY] = {**run, 'folder': beside.name}
    if second is not None:
        last = json.loads((second / job_folder.REPORT).read_text())
        report['second'] = {
            **last[LoopMode.CLOSED_LOOP],
            'part': last['part'],
            'folder': second.name,
        }
    write_atomically(folder / job_folder.REPORT, json.dumps(report, indent=1))
    return report


def _outcome(report: dict) -> str:
    from waam_view.outcome import outcome

    return outcome(report)


def _page(folder: Path) -> Path:
    from waam_view.report import write_report

    return write_report(folder)


def show(report: dict, console: Console, wall: float) -> None:
    """The figures as a table."""
    table = Table(title=f'{report["part"]}, tolerance +-{report["tolerance_mm"]:.2f} mm')
    rows = [
        ('RMS height error, mm', 'rms_mm', '{:.3f}'),
        ('... rim included, mm', 'rms_all_mm', '{:.3f}'),
        ('largest error, mm', 'max_mm', '{:.2f}'),
        ('within tolerance', 'share_in_tolerance', '{:.1%}'),
        ('wire, m', 'wire_m', '{:.1f}'),
        ('machine time, s', 'duration_s', '{:.0f}'),
        ('faults', 'faults', '{}'),
        ('telemetry lost', 'telemetry_lost', '{}'),
        ('verdict', 'verdict', '{}'),
        ('... rim included', 'verdict_with_rim', '{}'),
    ]
    runs = [p for p in (*LOOP_MODES, GANTRY) if p in report]
    table.add_column('')
    for p in runs:
        name = 'closed loop, gantry' if p == GANTRY else p.replace('_', ' ')
        table.add_column(name, justify='right')
    for label, key, form in rows:
        cells = [
            form.format(report[p][key]) if report[p].get(key) is not None else '-' for p in runs
        ]
        table.add_row(label, *cells)
    console.print(table)
    if report.get('ratio') is not None:
        console.print(f'closed loop / open loop: {report["ratio"]:.3f}')
    if LoopMode.CLOSED_LOOP in report:
        console.print(start_of(report[LoopMode.CLOSED_LOOP].get('trace') or {}))
    machine = sum(report[p]['duration_s'] for p in runs)
    console.print(f'{machine:.0f} s of machine time in {wall:.0f} s of yours')


def start_of(trace: dict) -> str:
    """What a job knew of the cell when it began; trace: of its report."""
    jobs = (trace.get('learned') or {}).get('jobs')
    if jobs is None:
        return 'nothing that former jobs have taught was used, and nothing is kept of this one'
    if not jobs:
        return 'started fresh: the first job of this cell; the next demo starts with what it taught (--fresh: without)'
    return f'started with what {jobs} former job{"s" if jobs > 1 else ""} of this cell taught (--fresh: without)'
