"""`waam lab --choose`: tries layouts of a job before it foretells what the best one gives."""

from __future__ import annotations

import shlex

from rich.console import Console
from rich.table import Table

from . import layouts
from .advance import JobAdvance
from .job import LabJob
from .many import run_many, workers_for
from .pieces import Pieces


def choose(
    job: LabJob, cells: int, workers: int, cluster: str = '', pieces: Pieces | None = None
) -> list[layouts.Trial]:
    """Every layout on the same cells; cluster and pieces as of run_many. Raises ValueError."""
    if job.goal.program is not None:
        raise ValueError('--choose: a program has its path; only parts can be laid in other ways')
    on_cells = {one: layouts.on_cells(layouts.laid(job, one), cells) for one in layouts.LAYOUTS}
    jobs = [j for found in on_cells.values() for j in found]
    with JobAdvance(len(jobs), 'layouts') as advance:
        results = run_many(jobs, workers_for(workers, len(jobs)), advance, cluster, pieces)
    return [
        layouts.Trial(one, tuple(results[i * cells : (i + 1) * cells]))
        for i, one in enumerate(on_cells)
    ]


def show(job: LabJob, trials: list[layouts.Trial], console: Console) -> layouts.Trial:
    """The trials as a table; returns the one to take."""
    taken = layouts.best(trials)
    table = Table(title=f'layouts, {len(trials[0].results)} cells each')
    for name in layouts.HEAD:
        table.add_column(name, justify='left' if name in ('layout', '') else 'right')
    for trial in trials:
        table.add_row(*layouts.row(trial, taken), style='bold green' if trial is taken else '')
    console.print(table)
    words = shlex.join(layouts.options(job, taken.layout))
    console.print(f'taken: [bold]{taken.layout.name}[/]' + (f' ({words})' if words else ''))
    return taken
