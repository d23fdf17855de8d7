"""The archive on disk: one writer at a time, any number of readers, and no moment at which a job is half there."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import duckdb

from waam_node.files import sync_folder, write_atomically
from waam_node.locks import locked
from waam_process.safe_files import FileError, Missing, read_json, read_text

from .catalog import (
    ArchiveError,
    Catalog,
    Entry,
    File,
    Segment,
    check_version,
    marker_name,
    parse,
    small_name,
)
from .content import Content
from .schema import TABLES, VERSION, select_list

DELETED = 'deleted.json'  # sources of jobs that somebody deleted -> their stamps
HEAD = 'archive.json'  # what the folder is, and the version of its schema
_MARKER = re.compile(r'(\d{8})\.json')
_NUMBERED = re.compile(r'(?:new-)?(\d{8})\b.*')
PATIENCE_S = 120.0  # that a writer waits for another one
FAN = 12  # segments of one order of size that are merged into one
Change = Callable[[str, Entry], Entry | None]  # None: the job goes


def literal(value: str) -> str:
    """A text as SQL literal, for the places where SQL takes no parameter."""
    return "'" + value.replace("'", "''") + "'"


class Store:
    """An archive folder. Reading makes nothing; the first writing makes the folder."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)
        self._known: dict[
            int, tuple[tuple[int, int], Segment]
        ] = {}  # markers that were read, with their stamps
        self._last: tuple[list[Segment], Catalog] = ([], Catalog())

    @property
    def exists(self) -> bool:
        """Whether there is an archive."""
        return (self.root / HEAD).is_file()

    def check_version(self) -> int:
        """Version of the schema. ArchiveError when another kind of folder, or one of a newer version, lies here."""
        try:
            data = read_json(self.root / HEAD)
            version: int = data['schema']
        except (OSError, ValueError, KeyError, TypeError) as e:
            raise ArchiveError(f'{self.root / HEAD}: not the head of an archive ({e})') from None
        check_version(version, str(self.root))
        return version

    def catalog(self) -> Catalog:
        """What counts now. ArchiveError when a marker is damaged; an empty one when there is no archive."""
        if not self.exists:
            return Catalog()
        self.check_version()
        found = [self.segment(n) for n in self.marker_numbers()]
        before, catalog = self._last
        if len(found) != len(before) or any(a is not b for a, b in zip(found, before, strict=True)):
            catalog = Catalog.of(found)
            self._last = found, catalog
        return catalog

    def deleted(self) -> dict[str, str]:
        """Sources of jobs that were deleted, with their stamps: they come back only when somebody names them."""
        try:
            data = read_json(self.root / DELETED)
        except Missing:
            return {}
        except (OSError, ValueError) as e:
            raise ArchiveError(f'{self.root / DELETED}: damaged ({e})') from None
        return data if isinstance(data, dict) else {}

    def marker_numbers(self) -> list[int]:
        """Of all markers on disk."""
        found = (_MARKER.fullmatch(f.name) for f in (self.root / 'segments').iterdir())
        return sorted(int(m.group(1)) for m in found if m)

    def segment(self, number: int) -> Segment:
        """ArchiveError when the marker is damaged."""
        file = self.root / marker_name(number)
        try:
            found = file.stat()
            stamp = found.st_mtime_ns, found.st_size
            before = self._known.get(number)
            if before is not None and before[0] == stamp:
                return before[1]
            content = read_text(file, limit=1 << 30)
        except (OSError, FileError) as e:
            raise ArchiveError(f'{file}: damaged ({e}); waam jobs verify --repair') from None
        segment = parse(content, str(file))
        if segment.number != number:
            raise ArchiveError(f'{file}: damaged (it is the marker of {segment.number})')
        self._known[number] = stamp, segment
        return segment

    @contextmanager
    def writing(self) -> Iterator[Writer]:
        """One writer at a time; another one waits, at most PATIENCE_S: then ArchiveError. What a killed writer has left
        is removed first."""
        (self.root / 'segments').mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            try:
                stack.enter_context(locked(self.root / '.lock', PATIENCE_S))
            except OSError as e:
                raise ArchiveError(f'{e.filename or self.root}: {e.strerror}') from None
            catalog = self.catalog()
            if not self.exists or self.check_version() < VERSION:
                write_atomically(self.root / HEAD, json.dumps({'schema': VERSION}))
            writer = Writer(self, catalog)
            writer.sweep()
            yield writer


class Writer:
    """Writes into a store that is locked; `catalog` is always what is on disk."""

    def __init__(self, store: Store, catalog: Catalog) -> None:
        self.store, self.root, self.catalog = store, store.root, catalog

    def sweep(self) -> None:
        """Removes what no marker counts: the remains of killed writers and of merged segments."""
        for number in self.catalog.replaced:
            (self.root / marker_name(number)).unlink(missing_ok=True)
        self.catalog.replaced.clear()
        for entry in (self.root / 'segments').iterdir():
            known = entry.name.isdigit() and int(entry.name) in self.catalog.segments
            if entry.is_dir() and not known and not entry.name.endswith('.bad'):
                shutil.rmtree(entry)
            elif entry.suffix == '.new':
                entry.unlink()

    def add(self, contents: list[Content]) -> None:
        """All of these jobs, or none of them, are in the archive when this returns or is killed."""
        from . import arrow

        number = self._next_number()
        jobs = {c.job: Entry(c.sha256, c.source, c.stamp, c.has_report) for c in contents}
        new = self._new_folder(number)
        files = {}
        for table in TABLES:
            rows = [row for c in contents for row in c.rows[table]]
            facts = arrow.write(new / f'{table}.parquet', arrow.table(table, rows))
            files[table] = File(name=small_name(number, table), **facts)  # type: ignore[arg-type]
        self._commit(Segment(number, (), jobs, files), new)

    def merge(self) -> None:
        """Keeps the number of segments small, so that a query opens few files."""
        while numbers := self.catalog.to_merge(FAN):
            self.rewrite(numbers, lambda job, entry: entry)

    def tidy(self) -> None:
        """Removes rows and files of jobs that were taken in again."""
        stale = sorted({number for number, _ in self.catalog.stale()})
        if stale:
            self.rewrite(stale, lambda job, entry: entry)
        self.sweep()

    def change(self, jobs: set[str], change: Change) -> None:
        """Rewrites the segments that hold rows of these jobs, stale ones included."""
        numbers = [n for n, s in self.catalog.segments.items() if jobs & set(s.jobs)]
        self.rewrite(numbers, lambda job, e: change(job, e) if job in jobs else e)
        self.sweep()

    def delete(self, jobs: set[str]) -> None:
        """These jobs leave the archive with all their rows and files."""
        entries = self.catalog.entries()
        gone = {entries[j].source: entries[j].stamp for j in jobs if j in entries}
        listed = {**self.store.deleted(), **gone}
        write_atomically(self.root / DELETED, json.dumps(listed, indent=1))
        self.change(jobs, lambda job, entry: None)

    def rewrite(self, numbers: list[int], change: Change) -> None:
        """These segments become one, with the jobs that `change` leaves."""
        number = self._next_number()
        kept = {n: self._kept(n, change) for n in numbers}
        jobs = {job: entry for entries in kept.values() for job, entry in entries.items()}
        new = self._new_folder(number)
        files = {t: self._merged(t, kept, new, number) for t in TABLES}
        old = [self.catalog.segments[n] for n in numbers]
        self._commit(Segment(number, tuple(s.number for s in old), jobs, files), new)
        for s in old:
            (self.root / marker_name(s.number)).unlink(missing_ok=True)
            shutil.rmtree(self.root / Path(small_name(s.number, 'jobs')).parent)

    def _kept(self, number: int, change: Change) -> dict[str, Entry]:
        entries = self.catalog.segments[number].jobs
        mine = {j: e for j, e in entries.items() if self.catalog.home[j] == number}
        return {j: c for j, e in mine.items() if (c := change(j, e)) is not None}

    def _merged(
        self, table: str, kept: dict[int, dict[str, Entry]], new: Path, number: int
    ) -> File:
        """Rows of the jobs that are kept, copied by DuckDB, which never holds all of them."""
        from . import arrow

        target = new / f'{table}.parquet'
        parts: list[str] = []
        parameters: list[list[str]] = []
        for n, jobs in kept.items():
            segment = self.catalog.segments[n]
            file = literal(str(self.root / segment.files[table].name))
            part = f'SELECT {select_list(table, segment.schema)} FROM read_parquet({file})'
            if len(jobs) < len(segment.jobs):
                part += ' WHERE job IN (SELECT unnest(?::VARCHAR[]))'
                parameters.append(list(jobs))
            parts.append(part)
        with duckdb.connect() as db:
            query = f'COPY ({" UNION ALL ".join(parts)}) TO {literal(str(target))} (FORMAT parquet, CODEC zstd)'
            (rows,) = db.execute(query, parameters).fetchone() or (0,)
        return File(name=small_name(number, table), **arrow.sealed(target), rows=rows)  # type: ignore[arg-type]

    def _next_number(self) -> int:
        found = (_NUMBERED.fullmatch(f.name) for f in (self.root / 'segments').iterdir())
        return max((int(m.group(1)) for m in found if m), default=0) + 1

    def _new_folder(self, number: int) -> Path:
        folder = self.root / 'segments' / f'new-{number:08d}'
        folder.mkdir()
        return folder

    def _commit(self, segment: Segment, new: Path) -> None:
        """The files first, then, in one step, the marker that makes them count."""
        sync_folder(new)
        os.replace(new, new.with_name(f'{segment.number:08d}'))
        sync_folder(new.parent)
        write_atomically(self.root / marker_name(segment.number), segment.text())
        sync_folder(new.parent)
        live = [s for n, s in self.catalog.segments.items() if n not in segment.replaces]
        self.catalog = Catalog.of([*live, segment])
