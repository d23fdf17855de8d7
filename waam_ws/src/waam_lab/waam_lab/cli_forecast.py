"""`waam forecast`: what a job will give, before metal, within a minute."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the laboratory is loaded only when a verb needs it
    from rich.console import Console

    from .forecast import Forecast
    from .job import LabJob, LabResult

# that a forecast may take; at least one cell per core is done, however long it takes
SECONDS = 60.0
CELLS = 12  # more narrow the mean, but not the band: single parts scatter as they do
FIRST_LOOK = 4  # cells after which a job that succeeds on none leaves the time to others, tried on the same ones
LEAST_TRIED = 2  # cells that a layout must have been tried on to be named


EXAMPLES = """\
examples:
  waam forecast part.stl --as-found worn.stl                     within ±0.2 mm as laid?
  waam forecast part.stl --as-found worn.stl --finish machined   does it clean up, and how much is to be machined?
  waam forecast bracket.stl --mode build --tolerance 0.3
  waam forecast worn.npz --shaft 80 --ends 20                    a worn shaft that turns
  waam forecast part.stl --as-found worn.stl --cell-file mycell.yaml   on the cell that `waam lab fit` has found

The job is run in the laboratory on cells that differ in metal, arc and scanner, up to a minute. Where it fails it is
said why, and other layouts are tried on the same cells: finish machined, narrow or parallel beads.
Written: forecast.json and forecast.png, into --out and beside the jobs, where the report of the same job finds them.

exit status: 0 it will succeed, 1 it will not, 2 refused, 130 ended with Ctrl-C
"""


def register(
    commands: argparse._SubParsersAction, add_part: Callable[[argparse.ArgumentParser], None]
) -> argparse.ArgumentParser:
    """Adds the verb `forecast`; the caller adds the options of the process."""
    p = commands.add_parser(
        'forecast',
        help='before metal: error, clean-up, time and wire of a job with 90 %% bands, and what would do better',
        description='Runs a job on simulated cells for up to a minute and says whether it will succeed, and why not.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_part(p)
    p.add_argument('--out', type=Path, metavar='DIR', help='a further folder for the files')
    p.add_argument(
        '--cells', type=int, default=CELLS, metavar='N', help=f'at most (default: {CELLS})'
    )
    p.set_defaults(run_command=_run, keep_jobs=False, workers=0)
    return p


def _run(args: argparse.Namespace) -> int:
    """0 will succeed, 1 will not. ValueError: refused."""
    from rich.console import Console

    from . import forecast
    from .cli_campaign import job_of

    if args.cells < 1:
        raise ValueError(f'--cells is {args.cells}, must be at least 1')
    job, notes = job_of(args, Path('jobs'))  # kept nowhere
    jobs_dir = args.jobs_dir(args.cell or '') if args.jobs_dir else Path('jobs').resolve()
    job = replace(job, goal=replace(job.goal, jobs_dir=jobs_dir))
    console = Console(highlight=False)
    for text in notes:
        console.print(f'as found: {text}')
    found = foretell(job, args.cells)
    show(found, console)
    facts = forecast.facts(found, shlex.join(['waam', *sys.argv[1:]]))
    for path in write(found, facts, args.out):
        print(f'written: {os.path.relpath(path)}')
    return 1 if found.fails else 0


def foretell(
    job: LabJob, cells: int = CELLS, workers: int = 0, models: Sequence[str] = ()
) -> Forecast:
    """Runs the job on up to so many cells within SECONDS, and where it fails others of its layouts. workers: 0 = one
    per core; models: metal models of the cells, () = all."""
    from waam_node.spread import Workers

    from . import layouts, plants
    from .forecast import Forecast

    began = time.monotonic()
    jobs = plants.on_cells(job, cells, models or plants.MODELS)

    def hopeless(found: list[LabResult]) -> bool:
        return len(found) >= FIRST_LOOK and not any(r.in_tolerance for r in found)

    until = began + SECONDS
    results = list(_within(jobs, workers, 'as asked', until, hopeless).values())
    first = Forecast(job, tuple(results))
    spent = time.monotonic() - began
    rounds = -(-len(results) // Workers(workers).for_pieces(len(jobs)))
    if not first.fails or spent + spent / rounds > SECONDS:
        return replace(first, seconds=spent)
    few = jobs[:FIRST_LOOK]
    # cell by cell, so that every layout gets its turn
    ways = [(one, layouts.laid(j, one)) for j in few for one in layouts.others(job)]
    found = _within([j for _, j in ways], workers, 'other layouts', until) if ways else {}
    tried = [
        layouts.Trial(one, tuple(r for i, r in found.items() if ways[i][0] == one))
        for one in dict.fromkeys(one for one, _ in ways)
    ]
    tried = [t for t in tried if len(t.results) >= min(LEAST_TRIED, len(few))]
    asked = layouts.Trial(layouts.ASKED, first.results[: len(few)])
    seconds = time.monotonic() - began
    return Forecast(job, first.results, tuple(tried), layouts.best(asked, tried), seconds)


def _within(
    jobs: list[LabJob],
    workers: int,
    title: str,
    until: float,
    enough: Callable[[list[LabResult]], bool] = lambda _: False,
) -> dict[int, LabResult]:
    """Results of as many jobs as come until then (monotonic s), of the first of every worker at least."""
    from waam_node.spread import Workers, spread

    from .advance import JobAdvance
    from .laboratory import failed
    from .many import PRELOAD, attempt

    crew = Workers(workers, PRELOAD)
    began, abreast, found = time.monotonic(), crew.for_pieces(len(jobs)), {}
    with (
        JobAdvance(len(jobs), title) as advance,
        closing(spread(dict(enumerate(jobs)), attempt, failed, crew)) as coming,
    ):
        for i, result in coming:
            found[i] = result
            advance(result)
            if len(found) % abreast:  # the others of this round are nearly done
                continue
            each = (time.monotonic() - began) / (len(found) // abreast)
            if time.monotonic() + each > until or enough(list(found.values())):
                break
    return dict(sorted(found.items()))


def show(f: Forecast, console: Console) -> None:
    """The figures with their bands, the verdict, and what is to be said of it."""
    from rich.markup import escape
    from rich.table import Table

    from . import forecast, plants

    goal = f.job.goal
    cell = f'cell {f.job.preset}' if not plants.own_physics(f.job) else 'cell as given'
    table = Table(title=f'{goal.file.name}, tolerance ±{goal.tolerance * 1e3:g} mm, {cell}')
    for name in ('forecast', 'expected', f'{forecast.BAND:.0%} of jobs'):
        table.add_column(name, justify='left' if name == 'forecast' else 'right')
    for row, e in f.rows.items():
        mean, low, high = (f'{v * row.factor:.{row.digits}f}' for v in e)
        table.add_row(row.label, f'{mean} {row.unit}', f'{low} … {high}')
    chance = f.chance
    table.add_row(
        'chance to clean up' if f.machined else 'chance to be in tolerance',
        f'{chance.value:.0%}',
        f'{chance.low:.0%} … {chance.high:.0%}',
    )
    console.print(table)
    colour = 'red' if f.fails else 'green'
    console.print(f'[bold {colour}]{escape(forecast.verdict(f))}[/]')
    for text in forecast.words(f):
        console.print(escape(text))
    seeds = [r.seed for r in f.results]
    console.print(
        f'{len(seeds)} cells (seeds {seeds[0]} to {seeds[-1]}) in {f.seconds:.0f} s; a real cell differs from the '
        'simulated ones as well'
    )


def write(f: Forecast, facts: dict, out: Path | None) -> list[Path]:
    """forecast.json and forecast.png, beside the jobs and in `out`; returns the paths of the JSON files."""
    from waam_job.model.goal import check
    from waam_job.store import forecasts
    from waam_job.store.folder import clean

    from . import pictures

    places = [forecasts.folder_of(check(f.job.goal, f.job.chuck))] + ([out] if out else [])
    maps, tolerance = f.maps, f.job.goal.tolerance
    for folder in places:
        folder.mkdir(parents=True, exist_ok=True)
        forecasts.write(folder, json.dumps(clean(facts), indent=1))
        if maps is not None:
            (folder / 'forecast.png').write_bytes(
                pictures.error_maps(maps, tolerance, len(f.done), f.causes if f.fails else {})
            )
    return [folder / forecasts.FILE for folder in places]
