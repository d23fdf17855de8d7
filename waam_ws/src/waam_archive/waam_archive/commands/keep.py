"""Verbs that change the archive, copy from it, or check it: ingest, export, delete, retain, verify."""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .. import policy
from ..schema import BULK, TABLES
from ..selection import moment
from .common import (
    Verbs,
    add_filters,
    add_verb,
    archive_folder,
    is_remote,
    opened,
    place,
    print_json,
    progress,
    remote,
    selection,
    shown,
)

if TYPE_CHECKING:
    from ..archive import Archive
    from ..catalog import Entry
    from ..ingest import Outcome
    from ..selection import Selection

FORMATS = ('parquet', 'csv', 'json')


def register(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    """Adds the verbs."""
    text = 'take in job folders, folders of them, and MCAP recordings; what is there already costs nothing'
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
        type=place,
        required=True,
        metavar='FOLDER',
        help='must not exist yet; or s3://BUCKET/FOLDER',
    )
    p.add_argument('--format', choices=FORMATS, default='parquet')
    p.add_argument(
        '--tables', nargs='+', choices=list(TABLES), default=list(TABLES), metavar='TABLE'
    )
    add_filters(p)
    text = 'take jobs out of the archive; job folders are not touched'
    p = add_verb(verbs, common, 'delete', text, _delete)
    p.add_argument(
        'names', metavar='JOB', nargs='+', help='ids, or parts of them that no other job has'
    )
    p.add_argument('--yes', action='store_true', help='do not ask')
    text = 'drop telemetry and maps of old jobs; reports, layers and beads stay, jobs without a report are left alone'
    p = add_verb(verbs, common, 'retain', text, _retain)
    p.add_argument('--older-than', metavar='AGE', help='such as 180d')
    p.add_argument(
        '--max-size', metavar='SIZE', help='oldest first until all arrays take no more, such as 50G'
    )
    p.add_argument('--dry-run', action='store_true', help='only say what would go')
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
    far = is_remote(args.archive)
    store = remote(args.archive, args).pull(bulk=False) if far else Store(archive_folder(args))
    with progress('taking in jobs') as tick:
        outcome = ingest(store, paths, tick, replace=args.replace)
    if store.exists:
        _push(args)
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

    archive = opened(args, bulk=any(t in BULK for t in args.tables))
    asked = archive, selection(args), args.format, args.tables
    counts = _export_to(args, *asked) if is_remote(args.output) else export(*asked, args.output)
    if args.json:
        print_json({'folder': str(args.output).partition('?')[0], 'rows': counts})
    else:
        print(
            f'{str(args.output).partition("?")[0]}: '
            + ', '.join(f'{t} {n}' for t, n in counts.items())
        )
    return 0


def _export_to(
    args: argparse.Namespace, archive: Archive, chosen: Selection, kind: str, tables: list[str]
) -> dict[str, int]:
    """To a store. ValueError when something is there."""
    from ..export import export

    at = remote(args.output, args)
    if not at.empty:
        raise ValueError(f'{at.place} exists; nothing was written')
    with tempfile.TemporaryDirectory(prefix='waam_export_') as scratch:
        counts = export(archive, chosen, kind, tables, Path(scratch) / 'tables')
        at.put(Path(scratch) / 'tables')
    return counts


def _push(args: argparse.Namespace) -> None:
    """What was changed goes to the store, when the archive is on one."""
    if is_remote(args.archive):
        with progress('copying to the store') as tick:
            remote(args.archive, args).push(tick)


def _delete(args: argparse.Namespace) -> int:
    archive = opened(args)
    jobs = sorted({archive.job_named(n) for n in args.names})
    if not args.yes and not _agreed(jobs):
        raise ValueError('nothing was deleted (--yes deletes without a question)')
    with archive.store.writing() as writer:
        writer.delete(set(jobs))
    _push(args)
    if args.json:
        print_json({'deleted': jobs})
    else:
        print(f'deleted: {", ".join(map(shown, jobs))}')
    return 0


def _agreed(jobs: list[str]) -> bool:
    if not sys.stdin.isatty():
        return False
    return (
        input(f'delete {", ".join(map(shown, jobs))} from the archive? [y/N] ').strip().lower()
        == 'y'
    )


def _retain(args: argparse.Namespace) -> int:
    if not (args.older_than or args.max_size):
        raise ValueError('say what may stay: --older-than AGE, --max-size SIZE')
    now = datetime.now(UTC).replace(tzinfo=None)
    age = now - moment(args.older_than, now) if args.older_than else None
    limit = policy.size(args.max_size) if args.max_size else None
    archive = opened(args)
    created = {
        r['job']: r['created'] for r in archive.rows(('jobs',), 'SELECT job, created FROM jobs')
    }
    held = [
        policy.Held(job, created.get(job), sum(f.bytes for f in e.bulk.values()), e.has_report)
        for job, e in archive.store.catalog().entries().items()
    ]
    gone = policy.chosen(held, policy.Policy(age, limit), now)
    if gone and not args.dry_run:
        with archive.store.writing() as writer:
            writer.change({h.job for h in gone}, _without_arrays)
        _push(args)
    size = sum(h.bytes for h in gone)
    if args.json:
        print_json({'jobs': [h.job for h in gone], 'bytes': size, 'dry_run': args.dry_run})
    else:
        verb = 'would go' if args.dry_run else 'dropped'
        print(f'{verb}: {" and ".join(BULK)} of {len(gone)} jobs, {size / 1e6:.1f} MB')
    return 0


def _without_arrays(_job: str, entry: Entry) -> Entry:
    return replace(entry, bulk={})


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
