"""Applies a policy of retention to an archive, and keeps one beside it that is applied whenever jobs are taken in."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from datetime import UTC, datetime

from waam_node.files import write_atomically
from waam_process.safe_files import read_json

from .catalog import ArchiveError, Catalog, Entry
from .policy import Decision, Held, Policy, decide
from .schema import BULK
from .store import RETENTION, Store, Writer


def kept_policy(store: Store) -> Policy:
    """The one of the archive; an empty one when there is none. ArchiveError."""
    file = store.root / RETENTION
    try:
        data = read_json(file)
        if not isinstance(data, dict) or set(data) - {'older_than', 'max_size'}:
            raise ValueError('wanted are older_than and max_size')
        return Policy(**data)
    except FileNotFoundError:
        return Policy()
    except (OSError, ValueError) as e:
        raise ArchiveError(f'{file}: damaged ({e}); waam jobs policy --clear') from None


def keep_policy(store: Store, policy: Policy) -> None:
    """From now on this one; an empty one: none."""
    with store.writing():
        if policy:
            write_atomically(store.root / RETENTION, json.dumps(asdict(policy)))
        else:
            (store.root / RETENTION).unlink(missing_ok=True)


def decision(store: Store, catalog: Catalog, policy: Policy) -> Decision:
    """What the policy means now."""
    from .archive import Archive

    query = 'SELECT job, created FROM jobs'
    archive = Archive(store.root)
    created = {r['job']: r['created'] for r in archive.rows(('jobs',), query)}
    held = [
        Held(job, created.get(job), sum(f.bytes for f in e.bulk.values()), e.has_report)
        for job, e in catalog.entries().items()
    ]
    return decide(held, policy, datetime.now(UTC).replace(tzinfo=None))


def apply(writer: Writer, policy: Policy) -> Decision:
    """Drops what the policy says; nothing is written when that is nothing."""
    found = decision(writer.store, writer.catalog, policy)
    if found.gone:
        writer.change({h.job for h in found.gone}, _without_arrays)
    return found


def apply_kept(writer: Writer) -> str:
    """The policy that is kept with the archive. Returns what it dropped, or why it could not be applied, in policy; '':
    nothing happened."""
    try:
        policy = kept_policy(writer.store)
        found = apply(writer, policy) if policy else None
    except ArchiveError as e:  # the jobs are in: that is no reason to fail
        return f'the policy was not applied: {e}'
    return f'policy of the archive: {told(found)}' if found and found.gone else ''


def told(found: Decision, done: bool = True) -> str:
    """done: it has happened."""
    what, verb = ' and '.join(BULK), 'dropped' if done else 'would go'
    return f'{verb}: {what} of {len(found.gone)} jobs, {found.bytes / 1e6:.1f} MB'


def _without_arrays(_job: str, entry: Entry) -> Entry:
    return replace(entry, bulk={})
