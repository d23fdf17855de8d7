"""Verbs that change the archive, copy from it, or check it: ingest, export, delete, retain, policy, verify."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..policy import Decision, Policy
from ..schema import TABLES
from .common import (
    Verbs,
    add_filters,
    add_verb,
    archive_folder,
    jobs_meant,
    opened,
    print_json,
    print_table,
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
    _register_retention(verbs, common)
    text = 'every file against its hash; exit status 1 when something is wrong'
    p = add_verb(verbs, common, 'verify', text, _verify)
    p.add_argument(
        '--sources', action='store_true', help='also the job folders against what was ingested'
    )
    p.add_argument(
        '--repair', action='store_true', help='set aside what is damaged and take it in again'
    )


def _register_retention(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    limits = argparse.ArgumentParser(add_help=False)
    limits.add_argument(
        '--older-than', default='', metavar='AGE', help='hours, days or weeks: 12h, 180d, 26w'
    )
    limits.add_argument(
        '--max-size',
        default='',
        metavar='SIZE',
        help='then the oldest, until all telemetry and maps take no more, such as 500M or 50G',
    )
    text = (
        'drop telemetry and maps of old jobs; reports, layers and beads stay, jobs without a report are left alone. '
        'Without limits: by the policy that is kept (waam jobs policy)'
    )
    p = add_verb(verbs, common, 'retain', text, _retain, limits)
    p.add_argument('--dry-run', action='store_true', help='only say what would go')
    text = (
        'show or set the policy of retention that is kept with the archive; it is applied whenever jobs are taken in, '
        'and by `waam jobs retain`'
    )
    p = add_verb(verbs, common, 'policy', text, _policy, limits)
    p.add_argument('--clear', action='store_true', help='no policy any more')


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


def _retain(args: argparse.Namespace) -> int:
    from ..retention import apply, decision, kept_policy

    asked = Policy(args.older_than, args.max_size)
    archive = opened(args)
    policy = asked or kept_policy(archive.store)
    if not policy:
        raise ValueError(
            'say what may stay (--older-than AGE, --max-size SIZE), or keep a policy: waam jobs policy'
        )
    if args.dry_run:
        found = decision(archive.store, archive.store.catalog(), policy)
    else:
        with archive.store.writing() as writer:
            found = apply(writer, policy)
    if args.json:
        print_json(_decided(args, policy, found))
    else:
        _tell_decision(args, policy, found)
    return 0


def _decided(args: argparse.Namespace, policy: Policy, found: Decision) -> dict[str, Any]:
    return {
        'policy': asdict(policy), 'jobs': [h.job for h in found.gone], 'bytes': found.bytes, 'dry_run': args.dry_run,
        'bytes_left': found.left, 'bytes_over': found.over, 'spared': [h.job for h in found.spared],
    }  # fmt: skip


def _tell_decision(args: argparse.Namespace, policy: Policy, found: Decision) -> None:
    from ..retention import told

    print(f'policy: {policy}')
    rows = [[h.created, h.job, h.bytes / 1e6] for h in found.gone]
    if args.dry_run and rows:
        print_table(['created', 'job', 'MB'], rows)
    print(f'{told(found, not args.dry_run)}; {found.left / 1e6:.1f} MB stay')
    if found.spared:
        size = sum(h.bytes for h in found.spared) / 1e6
        print(f'{len(found.spared)} jobs without a report or a time keep theirs, {size:.1f} MB')
    if found.over:
        print(f'that is {found.over / 1e6:.1f} MB more than {policy.max_size}')


def _policy(args: argparse.Namespace) -> int:
    from ..retention import keep_policy, kept_policy
    from ..store import Store

    given = Policy(args.older_than, args.max_size)
    if given and args.clear:
        raise ValueError('--clear goes with no limit')
    store = Store(archive_folder(args))
    if args.clear:
        policy = Policy()
    else:
        kept = kept_policy(store)
        policy = Policy(given.older_than or kept.older_than, given.max_size or kept.max_size)
    if given or args.clear:
        keep_policy(store, policy)
    if args.json:
        print_json(asdict(policy))
    else:
        print(f'policy: {policy}')
    return 0


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
