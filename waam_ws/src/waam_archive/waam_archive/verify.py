"""Is every byte of the archive what was written, and does every job folder still say what was ingested?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from . import folder_source
from .catalog import ArchiveError, Catalog, Entry, File, Segment, marker_name, small_name
from .ingest import ingest
from .schema import TABLES, version_of
from .store import Store


@dataclass
class Verdict:
    """Counts of files that were read, and what is wrong, in words. An empty list: sound."""

    files: int = 0
    jobs: int = 0
    problems: list[str] = field(default_factory=list)
    markers: list[int] = field(default_factory=list)  # damaged
    segments: list[int] = field(
        default_factory=list
    )  # with a damaged or missing file of a small table
    changed: list[str] = field(default_factory=list)  # sources that are not what was ingested

    @property
    def sound(self) -> bool:
        """Nothing is wrong."""
        return not self.problems


def verify(
    store: Store,
    sources: bool = False,
    tick: Callable[[int, int], None] = lambda done, of: None,
) -> Verdict:
    """Reads every file of the archive. sources: also the job folders that are still there."""
    verdict = Verdict()
    store.check_version()
    readable = []
    for number in store.marker_numbers():
        try:
            readable.append(store.segment(number))
        except ArchiveError as e:
            verdict.markers.append(number)
            verdict.problems.append(str(e))
    catalog = Catalog.of(readable)
    files = [(n, f) for n, s in catalog.segments.items() for f in s.files.values()]
    for done, (number, file) in enumerate(files):
        tick(done, len(files))
        if found := wrong_with(store.root, file):
            verdict.problems.append(found)
            if number not in verdict.segments:
                verdict.segments.append(number)
    verdict.files, verdict.jobs = len(files), len(catalog.home)
    if sources:
        _check_sources(catalog, verdict)
    return verdict


def wrong_with(root: Path, file: File) -> str:
    """'' when its bytes are those that were written."""
    path = root / file.name
    try:
        if path.stat().st_size != file.bytes:
            return f'{path}: {path.stat().st_size} bytes, {file.bytes} were written'
        if folder_source.hash_file(path) != file.sha256:
            return f'{path}: its hash is not that of what was written'
    except OSError as e:
        return f'{path}: {e.strerror or e}'
    return ''


def _check_sources(catalog: Catalog, verdict: Verdict) -> None:
    for job, entry in sorted(catalog.entries().items()):
        source = Path(entry.source)
        if folder_source.is_job(source) and folder_source.content_hash(source) != entry.sha256:
            verdict.changed.append(job)
            verdict.problems.append(
                f'{source}: not what was ingested as {job} (waam jobs ingest takes it)'
            )


# ---- repair --------------------------------------------------------------------------------------


def repair(store: Store, verdict: Verdict) -> list[str]:
    """Mends what can be mended, sets the rest aside under names that end in .bad, and says what it did. Removes
    nothing."""
    said = [_rebuild(store, number) for number in verdict.markers]
    lost: dict[str, str] = {}
    for number in verdict.segments:
        lost |= _set_aside(store, number)
    return said + _take_again(store, lost)


def _rebuild(store: Store, number: int) -> str:
    """A marker out of the Parquet files beside it; without them it is set aside."""
    marker = store.root / marker_name(number)
    try:
        segment = _from_files(store, number)
    except (ArchiveError, OSError, ValueError) as e:
        marker.replace(marker.with_name(f'{marker.name}.bad'))
        folder = marker.with_suffix('')
        if folder.is_dir():
            folder.replace(folder.with_name(f'{folder.name}.bad'))
        return f'{marker}: set aside as .bad, its files say too little ({e})'
    marker.write_text(segment.text(), encoding='utf-8')
    return f'{marker}: made again from its files, {len(segment.jobs)} jobs'


def _from_files(store: Store, number: int) -> Segment:
    from . import arrow

    def facts(name: str) -> File:
        rows = arrow.rows_of(store.root / name)
        return File(name=name, rows=rows, **arrow.sealed(store.root / name))  # type: ignore[arg-type]

    files = {t: facts(small_name(number, t)) for t in TABLES}
    jobs = {}
    for row in arrow.columns_of(
        store.root / files['jobs'].name, ('job', 'sha256', 'source', 'has_report')
    ):
        jobs[row['job']] = Entry(row['sha256'], row['source'], '', bool(row['has_report']))
    schema = version_of(arrow.names_of(store.root / files['jobs'].name))
    return Segment(number, (), jobs, files, schema)


def _set_aside(store: Store, number: int) -> dict[str, str]:
    """The marker and the files of a damaged segment get names that nothing reads. Returns its jobs and sources."""
    marker = store.root / marker_name(number)
    jobs = {j: e.source for j, e in store.segment(number).jobs.items()}
    folder = marker.with_suffix('')
    if folder.is_dir():
        folder.replace(folder.with_name(f'{folder.name}.bad'))
    marker.replace(marker.with_name(f'{marker.name}.bad'))
    return jobs


def _take_again(store: Store, lost: dict[str, str]) -> list[str]:
    said = []
    for job, source in sorted(lost.items()):
        place = Path(source)
        if place.exists():
            outcome = ingest(store, [place])
            done = job in (*outcome.added, *outcome.updated)
            said.append(
                f'{job}: {"ingested again" if done else "could not be ingested again"} from {place}'
            )
            said += outcome.refused
        else:
            said.append(
                f'{job}: {place} is gone; what is left of it lies in files that end in .bad'
            )
    return said
