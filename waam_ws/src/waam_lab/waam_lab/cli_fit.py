"""`waam lab fit`: the simulated cell fitted to records of one's own cell."""

from __future__ import annotations

import argparse
import hashlib
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_node.revision import software_revision
from waam_node.spread import Workers, add_options, spread

if TYPE_CHECKING:
    from waam_sim.plant import PlantParams

    from .pieces import Kept
    from .twin.records import JobRecord
    from .twin.solve import Each, Task

# Preset of the cell that is fitted. Others bring scatter that no record tells apart from what is fitted; it would count
# twice.
BASE = 'gentle'
EXAMPLES = """\
examples:
  waam lab fit jobs/20260101T080000Z_jaw jobs/20260102T093000Z_ring    two jobs of one cell
  waam lab fit jobs                                                    every job in a folder
  waam lab fit jobs --out mycell                                       mycell/cell.yaml, report.html, fit.json
  waam lab part.stl --as-found worn.stl --cell-file mycell/cell.yaml   what the next job will be on that cell
  waam up --cell-file mycell/cell.yaml                                 the whole graph on that cell
  waam lab fit arc.mcap wall_folder --out mycell                       recordings that are no jobs

Every layer is laid once more on the simulated cell: the torch goes where telemetry.npz says that it went, on the
surface that was scanned before. What grows is compared with the scan after it, the heat with the pyrometer, the current
with the source. Give jobs of one cell, one wire and one material that were laid with the same scanner; two to five do.

Every parameter comes with a 90 % interval. Where the records say little, the report says "not told" and the cell file
leaves the parameter as it was. Some are never told by a job, such as the wire's true diameter; the report lists them
with what would tell. docs/twin.md says how well intervals hold. A cell whose arcs would not strike at the beads of the
records is named.

Recordings that are no jobs say less, and each kind something else: an arc log (telemetry in an .mcap, as
`waam record import` makes it of anybody's log) current, voltage, their scatter, drift and correlation; a temperature
record with places that cool (an .mcap, too) conduction and losses; a folder with scans of a wall and the robot's log,
as for `waam scan fuse`, how much metal came and how unevenly. It is said what was fitted, the misfit before and after,
and what the recording cannot tell. Jobs and recordings are two fits: give the cell file of the first with --cell-file.

A fit that was ended (Ctrl-C, power) goes on where it was with the same command.

exit status: 0 fitted, 2 refused (no jobs, no maps, no arc, nothing told; the text says which), 130 ended with Ctrl-C
"""


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb `lab fit`. It is one of two words, since `lab` has a part as its first one; waam_bringup.cli joins
    them."""
    p = commands.add_parser(
        'lab fit',
        help='fit the simulated cell to records of your own cell',
        description='Fits the simulated cell (metal, heat, arc, scatter) to records of jobs, with intervals and with '
        'what the records cannot tell. The result is a cell file.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument(
        'jobs',
        type=Path,
        nargs='+',
        metavar='JOBS',
        help='job folders, or folders that hold some; or recordings',
    )
    p.add_argument('--out', type=Path, help='folder of the results (default: jobs/<time>_fit)')
    p.add_argument(
        '--cell-file',
        type=Path,
        help='cell to begin with; what the records do not tell stays as it says',
    )
    add_options(p)
    p.set_defaults(run_command=run_fit)


def each_on(workers: Workers, kept: Kept | None = None, software: str = '') -> Each:
    """Tasks of a fit spread over workers; their results in order, the same whatever the number of workers. kept: where
    results are as they come; what is there of this software is not done again."""

    def each(work: Callable[[Task], Any], tasks: list[Task]) -> Iterator[Any]:
        keys = [f'{software} {work.__name__} {t.key}' for t in tasks] if kept else []
        had = {i: kept.found(key, object) for i, key in enumerate(keys)} if kept else {}
        found = {i: result for i, result in had.items() if result is not None}
        waiting = {i: task for i, task in enumerate(tasks) if i not in found}
        told = 0
        for i, result in chain(list(found.items()), spread(waiting, work, lost, workers)):
            if kept and i in waiting:
                kept.keep(keys[i], result)
            found[i] = result
            while told in found:
                yield found[told]
                told += 1

    return each


def lost(_task: Task, error: Exception) -> Any:
    """A worker was lost again and again: there is no fit without its job."""
    raise ValueError(f'a worker was lost three times ({error})')


def run_fit(args: argparse.Namespace) -> int:
    """ValueError says what is wrong with the jobs."""
    from rich.console import Console

    from waam_job.store.folder import make_job_id
    from waam_sim.config import plant_params

    from . import params
    from .cli_campaign import settings_of
    from .pieces import Kept
    from .recorded.read import is_recording, is_wall
    from .twin import page
    from .twin.fit import fit
    from .twin.records import read_all

    overrides, _ = settings_of([], args.cell_file)
    base = plant_params(params.make(overrides, preset=BASE).cell)
    scatter = params.of_preset(BASE)
    scatter |= {k: v for k, v in overrides.get('cell', {}).items() if k in scatter}
    recorded = [p for p in args.jobs if is_recording(p) or is_wall(p)]
    if recorded:
        if others := [str(p) for p in args.jobs if p not in recorded]:
            raise ValueError(
                f'{others[0]} is no recording, {recorded[0]} is: fit jobs and recordings one after the other, '
                'the second with the --cell-file of the first'
            )
        return _fit_recorded(args, recorded, base, scatter)
    records = read_all(args.jobs)
    out = args.out or _jobs_dir() / make_job_id('fit')
    workers = Workers(args.workers, ('waam_lab.twin.solve',))
    software = software_revision()
    kept = Kept(args.out / 'pieces' if args.out else _unfinished(records, base, software))
    with _Bar(f'{len(records)} jobs') as bar:
        try:
            found = fit(records, base, bar.tick, each_on(workers, kept, software))
        except KeyboardInterrupt:
            print(f'waam: ended, {bar.done}; the same command goes on there', file=sys.stderr)
            raise
    target = page.write(out, found, shlex.join(['waam', *sys.argv[1:]]), scatter)
    kept.clear()
    # into a file or a pipe rich takes 80 columns, and cuts the names of parameters
    show(found, Console(highlight=False, width=None if sys.stdout.isatty() else 120))
    print(f'cell file: {os.path.relpath(out / page.CELL_FILE)}')
    print(f'report: {os.path.relpath(target)}')
    return 0


def _fit_recorded(
    args: argparse.Namespace, paths: list[Path], base: PlantParams, scatter: dict[str, Any]
) -> int:
    from waam_job.store.folder import make_job_id

    from .recorded import page
    from .recorded.fit import fit_recordings
    from .twin.page import CELL_FILE

    found = fit_recordings(paths, base)
    out = args.out or _jobs_dir() / make_job_id('fit')
    target = page.write(out, found, shlex.join(['waam', *sys.argv[1:]]), scatter)
    print('\n'.join(page.lines(found)))
    print(f'cell file: {os.path.relpath(out / CELL_FILE)}')
    print(f'report: {os.path.relpath(target)}')
    return 0


def _jobs_dir() -> Path:
    return Path(os.environ.get('WAAM_JOBS', 'jobs'))


def _unfinished(records: list[JobRecord], base: PlantParams, software: str) -> Path:
    """Pieces of this very fit; without --out its results get another folder each time."""
    told = repr((software, base, [r.fingerprint for r in records]))
    return _jobs_dir() / f'.fit-{hashlib.sha256(told.encode()).hexdigest()[:12]}'


def show(found: Any, console: Any) -> None:
    """What is told as a table, and the names of the rest."""
    from rich.table import Table

    from .twin.page import UNSAFE, number

    rows = Table(title='told by these records')
    for name in ('', 'found', '90 % interval', 'usual', 'unit'):
        rows.add_column(name, justify='left' if name in ('', 'unit') else 'right')
    for e in (e for e in found.estimates if e.told):
        interval = f'{number(e.low)} … {number(e.high)}'
        rows.add_row(
            e.unknown.name, number(e.value), interval, number(e.unknown.usual), e.unknown.unit
        )
    console.print(rows)
    silent = [e.unknown.name for e in found.estimates if not e.told]
    if silent:
        console.print(f'[yellow]not told, left as usual:[/] {", ".join(silent)}')
    if found.strikes is not None:
        if not found.strikes.safe:
            console.print(f'[bold red]{UNSAFE}[/]')
        console.print(found.strikes.words)
    for m in found.misfits:
        before, after = (v * 1e3 for v in m.height)
        console.print(
            f'{m.job}: growth of its layers off by {before:.3f} mm before, {after:.3f} mm after'
        )


class _Bar:
    """Jobs laid anew, on a terminal; nothing elsewhere."""

    def __init__(self, title: str) -> None:
        from rich.console import Console
        from rich.progress import Progress

        console = Console(stderr=True)
        self._progress = Progress(console=console, disable=not console.is_terminal)
        self._task = self._progress.add_task(title, total=None)
        self._steps = self._total = 0

    def __enter__(self) -> _Bar:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    @property
    def done(self) -> str:
        """So far, in words."""
        return f'{self._steps} of {self._total} steps done' if self._total else 'no step done yet'

    def tick(self, total: int) -> None:
        """One of `total` steps is done."""
        self._steps, self._total = self._steps + 1, total
        self._progress.update(self._task, total=total, advance=1)
