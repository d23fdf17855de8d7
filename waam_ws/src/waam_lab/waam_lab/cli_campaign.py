"""The work of `waam lab`: from the command line to the jobs, and from the results to the screen and the report."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from waam_job.cli_program import asked_of, with_finish, with_shaft
from waam_job.model.goal import JobError, JobGoal, check
from waam_job.store.folder import make_job_id
from waam_node.revision import software_revision
from waam_process.operating import DEFAULT_MATERIAL, ROBOT

from . import params, report
from .advance import JobAdvance
from .bands import in_tolerance
from .job import LabJob
from .laboratory import on_table, over_seeds, physics_of
from .many import run_many, workers_for
from .pieces import Pieces
from .robot import urdf_settings

MAX_SEEDS = 10_000


def parse_seeds(text: str) -> list[int]:
    """'20' -> 1 .. 20; '3-6,11' -> these. ValueError says what is wrong."""
    wrong = ValueError(f"--seeds '{text}': a number N (1 .. N) or a list such as 3-6,11")
    if re.fullmatch(r'\d+', text):
        seeds = list(range(1, int(text) + 1)) if int(text) <= MAX_SEEDS else []
    else:
        seeds = []
        for piece in text.split(','):
            found = re.fullmatch(r'\s*(\d+)(?:-(\d+))?\s*', piece)
            if not found:
                raise wrong
            first, last = int(found[1]), int(found[2] or found[1])
            if not first <= last < first + MAX_SEEDS:
                raise wrong
            seeds += range(first, last + 1)
    if not 0 < len(seeds) <= MAX_SEEDS:
        raise ValueError(f"--seeds '{text}': 1 to {MAX_SEEDS} jobs can be run")
    return list(dict.fromkeys(seeds))


def settings_of(
    texts: list[str], cell_file: Path | None
) -> tuple[params.Overrides, tuple[str, ...]]:
    """Overrides of the nodes, and settings of the planner."""
    plan = tuple(t.removeprefix('plan.') for t in texts if t.startswith('plan.'))
    wanted: dict[str, dict[str, Any]] = {}
    if cell_file is not None:
        found = params.read_file(cell_file)
        if strange := [node for node in found if node.rpartition('/')[2] != 'cell']:
            raise ValueError(
                f"--cell-file {cell_file}: holds '{strange[0]}', must hold only 'cell'"
            )
        wanted['cell'] = params.of_node(found, 'cell')
    for node, values in params.parse_settings(
        t for t in texts if not t.startswith('plan.')
    ).items():
        wanted.setdefault(node, {}).update(values)
    return wanted, plan


def _with_cell(
    args: argparse.Namespace, overrides: params.Overrides
) -> tuple[params.Overrides, str]:
    """With what the cell file says, before all others; and the wire, '' = it is not said. ValueError for a robot, of
    which a cell file says nothing."""
    if args.of_cell is None or (args.machine == ROBOT and not args.cell):
        return overrides, ''
    if args.machine == ROBOT:
        raise ValueError('--cell is the file of a gantry: not with --machine robot')
    told, wire, name = args.of_cell(args.cell or '')
    if name:
        print(f'cell file: {name}')
    nodes = (*told, *(n for n in overrides if n not in told))
    return {n: {**told.get(n, {}), **overrides.get(n, {})} for n in nodes}, wire


def job_of(args: argparse.Namespace, out: Path) -> tuple[LabJob, tuple[str, ...]]:
    """The job of the command line, checked as far as possible before it runs, and what of the worn part's file was left
    out or assumed. Raises ValueError."""
    overrides, plan = settings_of(args.set, args.cell_file)
    overrides, wire = _with_cell(args, overrides)
    if args.urdf is not None:
        if args.machine != ROBOT:
            raise ValueError('--urdf belongs to --machine robot')
        overrides = urdf_settings.settings(args.urdf, overrides)
    shaft = with_shaft(args)
    goal = JobGoal(
        material=args.material or wire or DEFAULT_MATERIAL,
        jobs_dir=(out / 'jobs').resolve(),
        layers=args.layers,
        layer_height=args.layer_height * 1e-3,
        bead_width=args.bead_width * 1e-3,
        k_gain=args.k_gain,
        tolerance=args.tolerance * 1e-3,
        scale=args.scale,
        strategy=args.strategy,
        allowance=args.allowance * 1e-3,
        passes=args.passes,
        plan_settings=(*with_finish(args), *shaft, *plan),
        repair=args.repair,
        **asked_of(args, 'restore' if args.as_found or shaft else 'build').goal_fields(),
    )
    worn = args.part if shaft else args.as_found
    as_found = worn.resolve() if worn else None
    job = LabJob(
        goal,
        as_found,
        overrides=overrides,
        preset=args.preset,
        machine=args.machine,
        keep=args.keep_jobs,
        learned=args.learned,
    )
    return job, _check(job, args)


def _check(job: LabJob, args: argparse.Namespace) -> tuple[str, ...]:
    for name in ('layers', 'workers'):
        if getattr(args, name) < 0:
            raise ValueError(f'--{name} is {getattr(args, name)}, must not be negative')
    if job.learned is not None and not job.learned.is_dir():
        raise ValueError(f'--learned {job.learned}: no such folder')
    if job.as_found is not None and job.goal.mode == 'build':
        raise ValueError('--as-found belongs to mode restore; a build begins on a flat plate')
    known = params.make(job.overrides, preset=job.preset)
    try:
        checked = check(job.goal, job.chuck)
    except JobError as e:
        raise ValueError(str(e)) from None
    return on_table(job, checked, known, physics_of(job, known)).notes


def run_campaign(args: argparse.Namespace) -> int:
    """0 all jobs ran, 1 at least one failed."""
    seeds = parse_seeds(args.seeds)
    jobs_dir = Path(os.environ.get('WAAM_JOBS', 'jobs'))
    out = args.out or jobs_dir / make_job_id(f'lab-{args.part.stem}')
    job, notes = job_of(args, out)
    console = Console(highlight=False)
    pieces = Pieces(out / 'pieces', software_revision())
    workers = workers_for(args.workers, len(seeds))
    started = time.monotonic()
    with JobAdvance(len(seeds), job.goal.title) as advance:
        try:
            results = run_many(over_seeds(job, seeds), workers, advance, pieces)
        except KeyboardInterrupt:
            print(
                f'{advance.done} of {len(seeds)} jobs are done; go on with --out {out}',
                file=sys.stderr,
            )
            raise
    told = shlex.join(['waam', *sys.argv[1:]])
    wall = time.monotonic() - started
    campaign = report.Campaign(job, results, wall, workers, told, notes=notes)
    page = report.write(out, campaign)
    pieces.clear()
    show(campaign, console)
    print(f'report: {os.path.relpath(page)}')
    return 1 if campaign.failed else 0


def show(campaign: report.Campaign, console: Console) -> None:
    """The bands as a table, and what failed."""
    goal, share = campaign.job.goal, in_tolerance(campaign.results)
    table = Table(
        title=f'{goal.file.name}, tolerance ±{goal.tolerance * 1e3:g} mm, cell {campaign.job.preset}'
    )
    for name in ('', 'mean', 'next part, 95 %', 'best', 'worst', 'seed'):
        table.add_column(name, justify='left' if not name else 'right')
    for row, band in campaign.rows():
        table.add_row(row.label, *report.cells(row, band))
    if campaign.rows():
        console.print(table)
    colour = 'green' if share.value >= 0.95 else 'yellow' if share.count else 'red'
    console.print(
        f'[{colour}]{share.count} of {share.of} jobs {campaign.word}[/], of all such jobs '
        f'{share.low * 100:.0f} to {share.high * 100:.0f} % (95 % confidence)'
    )
    for text in campaign.warnings:
        console.print(f'[yellow]warning:[/] {escape(text)}')
    failed = campaign.failed
    for r in failed[:5]:
        console.print(f'[red]seed {r.seed} failed:[/] {r.message}')
    if len(failed) > 5:
        console.print(f'... and {len(failed) - 5} more; report.json names them')
    console.print(
        f'{len(campaign.results)} jobs in {campaign.wall:.0f} s {campaign.by}, '
        f'{campaign.speed:.0f} s of machine time per second and core'
    )
