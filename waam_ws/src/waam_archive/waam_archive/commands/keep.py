"""Verbs that change the archive, copy from it, or check it: ingest, export, delete, verify."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ..schema import TABLES
from .common import (
    Verbs,
    add_filters,
    add_verb,
    archive_folder,
    jobs_meant,
    opened,
    print_json,
    progress,
    selection,
    shown,
)

if TYPE_CHECKING:
    from ..ingest import Outcome

FORMATS = ('parquet', 'csv', 'json')


def register(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    """Adds the verbs."""
    text = 'take in job folders, folders of them, what is there already costs nothing'
    p = add_verb(verbs, common, 'ingest', text, _ingest)
    p.add_argument(
        'paths', metavar='PATH', nargs='*', type=Path, help='default: the folder of jobs'
    )
    p.add_argument(
        '--replace', action='store_true', help='also a job whose id another folder has taken'
    )
    text = 'tables of the chosen jobs as files, for other programs'
    p = add_verb(verbs, common, 'export', text, _export)
    p.add_argument(
        '-o',
        '--output',
        type=Path,
        required=True,
        metavar='FOLDER',
        help='must not exist yet',
    )
    p.add_argument('--format', choices=FORMATS, default='parquet')
    p.add_argument(
        '--tables', nargs='+', choices=list(TABLES), default=list(TABLES), metavar='TABLE'
    )
    add_filters(p)
    text = 'take jobs out of the archive; job folders are not touched'
    p = add_verb(verbs, common, 'delete', text, _delete)
    p.add_argument(
        'names',
        metavar='JOB',
        nargs='*',
        help='ids, or parts of them that no other job has; or filters',
    )
    add_filters(p)
    p.add_argument('--yes', action='store_true', help='do not ask')
    text = 'every file against its hash; exit status 1 when something is wrong'
    p = add_verb(verbs, common, 'verify', text, _verify)
    p.add_argument(
        '--sources', action='store_true', help='also the job folders against what was ingested'
    )
    p.add_argument(
        '--repair', action='store_true', help='set aside what is damaged and take it in again'
    )


def _ingest(args: argparse.Namespace) -> int:
    from ..ingest import ingest
    from ..store import Store

    paths = args.paths or [args.jobs_dir()]
    store = Store(archive_folder(args))
    with progress('taking in jobs') as tick:
        outcome = ingest(store, paths, tick, replace=args.replace)
    if args.json:
        print_json(asdict(outcome))
    else:
        _tell(outcome)
    return 1 if outcome.refused else 0


def _tell(outcome: Outcome) -> None:
    counts = ('added', 'updated', 'unchanged', 'running')
    print(', '.join(f'{len(getattr(outcome, c))} {c}' for c in counts))
    for line in outcome.running:
        print(f'not yet: {line}')
    for line in (*outcome.refused, *outcome.notes):
        print(f'waam: warning: {line}', file=sys.stderr)


def _export(args: argparse.Namespace) -> int:
    from ..export import export

    counts = export(opened(args), selection(args), args.format, args.tables, args.output)
    if args.json:
        print_json({'folder': str(args.output), 'rows': counts})
    else:
        print(f'{args.output}: ' + ', '.join(f'{t} {n}' for t, n in counts.items()))
    return 0


def _delete(args: argparse.Namespace) -> int:
    archive = opened(args)
    jobs = sorted(jobs_meant(args, archive))
    if not args.yes and not _agreed(jobs):
        raise ValueError('nothing was deleted (--yes deletes without a question)')
    with archive.store.writing() as writer:
        writer.delete(set(jobs))
    if args.json:
        print_json({'deleted': jobs})
    else:
        print(f'deleted: {_listed(jobs)}')
    return 0


def _agreed(jobs: list[str]) -> bool:
    if not sys.stdin.isatty():
        return False
    return input(f'delete {_listed(jobs)} from the archive? [y/N] ').strip().lower() == 'y'


def _listed(jobs: list[str]) -> str:
    more = f' and {len(jobs) - 20} more' if len(jobs) > 20 else ''
    return f'{len(jobs)} jobs: {", ".join(map(shown, jobs[:20]))}{more}'


def _verify(args: argparse.Namespace) -> int:
    from ..store import Store
    from ..verify import repair, verify

    store = Store(archive_folder(args))
    with progress('reading files') as tick:
        verdict = verify(store, args.sources, tick)
    mended = repair(store, verdict) if args.repair and not verdict.sound else []
    if args.json:
        print_json({**asdict(verdict), 'sound': verdict.sound, 'repaired': mended})
    else:
        print(
            f'{verdict.jobs} jobs, {verdict.files} files: {"sound" if verdict.sound else "not sound"}'
        )
        for line in (*verdict.problems, *mended):
            print(line)
    return 0 if verdict.sound else 1
