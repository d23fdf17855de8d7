"""Job folders go into the archive: what is new or changed, each as a whole, again after a kill."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from .catalog import Catalog
from .content import Content
from .folder_source import NotFinished, SourceError, is_job, read, stamp_of
from .store import HEAD, Store, Writer

BATCH_JOBS, BATCH_BYTES = 16, 32 << 20  # jobs and bytes of arrays that are committed together
DEPTH = 4  # folders below the one that was named: cells/cell2/<demo>/<job>


@dataclass
class Outcome:
    """Ids of the jobs by what became of them, and every refusal and remark in words."""

    added: list[str] = field(default_factory=list)
    updated: list[str] = field(default_factory=list)
    unchanged: list[str] = field(default_factory=list)
    running: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def sources(path: Path, depth: int = DEPTH, refused: list[str] | None = None) -> Iterator[Path]:
    """Job folders at or below a path. SourceError when there is no such folder. refused: takes folders
    that cannot be looked into, with the reason."""
    if not path.is_dir():
        raise SourceError(f'{path}: no such folder (jobs are taken in by their folders)')
    if is_job(path):
        yield path
        return
    if depth and not (path / HEAD).is_file():
        try:
            found = sorted(path.iterdir())
        except OSError as e:
            if refused is None:
                raise SourceError(f'{path}: {e.strerror}') from None
            refused.append(f'{path}: {e.strerror}')
            return
        for below in found:
            if below.is_dir() and not below.is_symlink() and not below.name.startswith('.'):
                yield from sources(below, depth - 1, refused)


def pending(store: Store, paths: Iterable[Path], outcome: Outcome, named: bool) -> list[Path]:
    """Sources that are new or changed. named: somebody asked for them; jobs that were deleted come back only then."""
    known = {e.source: (job, e.stamp) for job, e in store.catalog().entries().items()}
    gone = {} if named else store.deleted()
    found = []
    for path in paths:
        for source in sources(path, refused=outcome.refused):
            try:
                place, stamp = str(source.resolve()), stamp_of(source)
            except (OSError, ValueError) as e:
                outcome.refused.append(str(e))
                continue
            job, before = known.get(place, ('', ''))
            if before == stamp:
                outcome.unchanged.append(job)
            elif gone.get(place) != stamp:
                found.append(source)
    return found


def ingest(
    store: Store,
    paths: Iterable[Path],
    tick: Callable[[int, int], None] = lambda done, of: None,
    named: bool = True,
    replace: bool = False,
) -> Outcome:
    """All jobs at or below the paths. A source that cannot be taken is refused by name; the others go on.

    tick(done, of) reports progress. replace: a job of the same id from another folder takes the place of the old one.
    """
    outcome = Outcome()
    waiting = pending(store, paths, outcome, named)
    if not waiting:
        return outcome
    with store.writing() as writer:
        batch: list[Content] = []
        for done, source in enumerate(waiting):
            tick(done, len(waiting))
            content = _taken(source, writer.catalog, outcome, replace, batch)
            if content is not None:
                batch.append(content)
            if len(batch) >= BATCH_JOBS or sum(c.size for c in batch) >= BATCH_BYTES:
                _commit(writer, batch, outcome)
        _commit(writer, batch, outcome)
        if outcome.updated:
            writer.tidy()
        tick(len(waiting), len(waiting))
    return outcome


def _commit(writer: Writer, batch: list[Content], outcome: Outcome) -> None:
    if not batch:
        return
    for content in batch:
        known = content.job in writer.catalog.home
        (outcome.updated if known else outcome.added).append(content.job)
    writer.add(batch)
    writer.merge()
    batch.clear()


def _taken(
    source: Path, catalog: Catalog, outcome: Outcome, replace: bool, batch: list[Content]
) -> Content | None:
    try:
        content = read(source)
    except NotFinished as e:
        outcome.running.append(str(e))
        return None
    except (SourceError, OSError) as e:
        outcome.refused.append(str(e))
        return None
    except Exception as e:  # one job that no check has foreseen takes no other one along
        outcome.refused.append(f'{source}: {type(e).__name__}: {" ".join(str(e).split())[:200]}')
        return None
    outcome.notes += content.notes
    twin = next((c for c in batch if c.job == content.job), None)
    if (
        twin is not None and twin.sha256 == content.sha256
    ):  # a copy of the folder, such as jobs/latest may be
        outcome.unchanged.append(content.job)
        return None
    if twin is not None:
        outcome.refused.append(_twice(content, twin.source))
        return None
    before = catalog.entry(content.job)
    if before is None:
        return content
    if before.sha256 == content.sha256:
        outcome.unchanged.append(content.job)
        return None
    old = Path(before.source)
    if before.source != content.source and is_job(old) and not replace:
        outcome.refused.append(_twice(content, str(old)))
        return None
    return content


def _twice(content: Content, other: str) -> str:
    return (
        f'{content.source}: a different job of the same id ({content.job}) is there from {other}; '
        '--replace takes this one'
    )
