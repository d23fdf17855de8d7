"""What the verbs of `waam jobs` share: the archive, filters, JSON and tables on the screen."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_process.cli_options import as_table

from ..selection import TEXTS, Selection, moment
from ..values import plain

if TYPE_CHECKING:
    from ..archive import Archive
    from ..ingest import Outcome

Verbs = argparse._SubParsersAction
Row = dict[str, Any]


def add_verb(
    verbs: Verbs,
    common: argparse.ArgumentParser,
    name: str,
    text: str,
    run: Callable[[argparse.Namespace], int],
    *more: argparse.ArgumentParser,
) -> argparse.ArgumentParser:
    """A verb with the options that all of them have, and with those of `more`."""
    p = verbs.add_parser(name, help=text, description=text, parents=[common, *more])
    p.set_defaults(run_command=run)
    return p


def add_filters(p: argparse.ArgumentParser) -> None:
    """--part, --material ... --since, --until."""
    group = p.add_argument_group(
        'filters', "texts take * and ?, capitals do not count; '-' finds jobs without a value"
    )
    for name in TEXTS:
        group.add_argument(
            f'--{name.replace("_", "-")}', default='', metavar='TEXT', dest=f'only_{name}'
        )
    group.add_argument(
        '--since', metavar='TIME', help='2026-11-21, 2026-11-21T09:30 (UTC), or an age: 30d, 12h'
    )
    group.add_argument('--until', metavar='TIME', help='up to, without')


def selection(args: argparse.Namespace) -> Selection:
    """Filters of the command line. ValueError for a time that is none."""
    now = datetime.now(UTC).replace(tzinfo=None)
    texts = {name: getattr(args, f'only_{name}') for name in TEXTS}
    since, until = (moment(v, now) if v else None for v in (args.since, args.until))
    return Selection(**texts, since=since, until=until)


def jobs_meant(args: argparse.Namespace, archive: Archive) -> list[str]:
    """Of a verb that takes names and filters: the jobs named, in that order, or those of the filters, newest first.
    ValueError when neither or both were given, or nothing fits."""
    chosen = selection(args)
    if bool(args.names) == (chosen != type(chosen)()):
        raise ValueError('say which jobs: either their ids or filters, such as --part TEXT')
    if args.names:
        return list(dict.fromkeys(archive.job_named(n) for n in args.names))
    found = [str(r['job']) for r in archive.jobs(chosen)]
    if not found:
        raise ValueError('no job fits these filters')
    return found


def archive_folder(args: argparse.Namespace) -> Path:
    """Of --archive, else archive/ in the folder of jobs."""
    return args.archive or args.jobs_dir() / 'archive'


def opened(args: argparse.Namespace) -> Archive:
    """The archive, with the new jobs of the folder of jobs in it."""
    from ..archive import Archive
    from ..ingest import ingest

    archive, jobs = Archive(archive_folder(args)), args.jobs_dir()
    if not args.no_ingest and jobs.is_dir():
        with progress('taking in new jobs') as tick:
            outcome = ingest(archive.store, [jobs], tick, named=False)
        complain(outcome)
    if not archive.store.exists:
        raise ValueError(
            f'{archive.store.root}: there is no archive, and no finished job in {jobs} '
            '(waam jobs ingest FOLDER)'
        )
    return archive


def complain(outcome: Outcome) -> None:
    """What was refused or left out, on stderr."""
    for line in (*outcome.refused, *outcome.notes):
        print(f'waam: warning: {line}', file=sys.stderr)


@contextmanager
def progress(text: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr, when somebody looks and there is more than a little to do."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = TextColumn(text), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    hidden = not sys.stderr.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=hidden) as bar:
        task = bar.add_task(text, total=None, visible=False)
        yield lambda done, of: bar.update(task, completed=done, total=of, visible=of > 3)


# ---- printing ------------------------------------------------------------------------------------


def print_json(value: Any) -> None:
    """Numbers that JSON has not become null, times ISO 8601."""
    print(json.dumps(plain(value), indent=1, ensure_ascii=False))


def shown(value: Any) -> str:
    """For a table on the screen; control characters of names do nothing to the terminal."""
    if value is None:
        return '-'
    if isinstance(value, float):
        return f'{value:.4g}' if math.isfinite(value) else '-'
    if isinstance(value, datetime):
        return f'{value:%Y-%m-%d %H:%M}'
    return ''.join(c if c.isprintable() else '?' for c in str(value))


def print_table(columns: list[str], rows: list[list[Any]]) -> None:
    """Plain columns, as wide as what stands in them."""
    print(as_table(columns, [[shown(v) for v in row] for row in rows]))
