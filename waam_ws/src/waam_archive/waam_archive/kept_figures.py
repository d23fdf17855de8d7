"""A row per job with all figures of a trend, in a file of its own: the next program need not read a million beads.

The file is named by what it was made from (the question, and names, times and sizes of all markers), so it is never
wrong; when the archive has changed another one is made, out of this one and the segments that are new. It holds nothing
that the archive does not; it may be deleted.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import duckdb

from .archive import Archive
from .catalog import Catalog, marker_name
from .metrics import KEPT, rows
from .store import literal

FOLDER = '.figures'
TABLES = ('jobs', 'beads')  # what figures are made from
Answer = TypeVar('Answer')
Database = duckdb.DuckDBPyConnection


class KeptFigures:
    """Questions to that table. Keeps it in memory as long as nothing is written into the archive."""

    def __init__(self, archive: Archive) -> None:
        self.archive = archive
        self._question = _short(rows())
        self._open: tuple[str, Database] | None = None

    def ask(self, question: Callable[[Any], Answer]) -> Answer:
        """Answer of a question to a connection. ArchiveError names a damaged file."""
        key = self._key()
        if self._open is None or self._open[0] != key:
            if self._open is not None:
                self._open[1].close()
                self._open = None
            self._open = key, self._table(key)
        return question(self._open[1])

    def _key(self) -> str:
        return f'{self._question}-{_short(repr(self.archive.store.stamps()))}'

    def _table(self, key: str) -> Database:
        file = self.archive.store.root / FOLDER / f'{key}.parquet'
        found = _load(file)
        if found is None:
            found = self.archive.twice(self._gathered)
            if self.archive.store.exists:
                self._keep(found, file, key)
            found.execute(f'DELETE FROM {KEPT} WHERE stale')
        return found

    def _gathered(self) -> Database:
        db = _database()
        try:
            self._gather(db)
        except BaseException:
            db.close()
            raise
        return db

    def _keep(self, db: Database, file: Path, key: str) -> None:
        """For the next program; nothing happens where it cannot be written, or somebody writes into the archive."""
        part = file.with_suffix(f'.{os.getpid()}.part')
        try:
            file.parent.mkdir(exist_ok=True)
            db.execute(f'COPY {KEPT} TO {literal(str(part))} (FORMAT parquet, CODEC zstd)')
            if self._key() == key:
                os.replace(part, file)
                for other in file.parent.glob('*.parquet'):
                    if other != file:
                        other.unlink(missing_ok=True)
        except (OSError, duckdb.Error):
            return
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def _gather(self, db: Database) -> None:
        """The table of all segments, each row with its segment (`marker`) and whether a newer one has its job."""
        catalog = self.archive.store.catalog()
        stamps = {name: f'{name} {time} {size}' for name, time, size in self.archive.store.stamps()}
        markers = {n: stamps.get(marker_name(n), '') for n in catalog.segments}
        self._read(db, Catalog(), '')
        known = self._known(db, set(markers.values()))
        for number, marker in markers.items():
            if marker not in known:
                self._read(db, Catalog.of([catalog.segments[number]]), marker)
        stale = [(markers[n], job) for n, job in catalog.stale()]
        if stale:
            db.executemany(f'UPDATE {KEPT} SET stale = true WHERE marker = ? AND job = ?', stale)

    def _read(self, db: Database, catalog: Catalog, marker: str) -> None:
        """Adds the rows of a catalog; without segments it makes the table."""
        for table in TABLES:
            db.execute(f'CREATE OR REPLACE VIEW "{table}" AS {self.archive.view(table, catalog)}')
        verb = f'INSERT INTO {KEPT}' if catalog.segments else f'CREATE TABLE {KEPT} AS'
        db.execute(f'{verb} SELECT {literal(marker)} AS marker, false AS stale, * FROM ({rows()})')

    def _known(self, db: Database, wanted: Collection[str]) -> set[str]:
        """Takes the rows of these segments out of the newest file of the same question; their markers."""
        files = list((self.archive.store.root / FOLDER).glob(f'{self._question}-*.parquet'))
        for file in sorted(files, reverse=True, key=lambda f: f.stat().st_mtime_ns)[:1]:
            asked = f'FROM read_parquet({literal(str(file))}) WHERE marker IN (SELECT unnest(?))'
            with suppress(duckdb.Error):
                db.execute(
                    f'INSERT INTO {KEPT} BY NAME SELECT * REPLACE (false AS stale) {asked}',
                    [list(wanted)],
                )
        found = db.execute(f'SELECT DISTINCT marker FROM {KEPT}').fetchall()
        return {str(marker) for (marker,) in found}


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _database() -> Database:
    return duckdb.connect(config={'temp_directory': ''})


def _load(file: Path) -> Database | None:
    """None when the file is not there or cannot be read."""
    if not file.is_file():
        return None
    db = _database()
    try:
        kept = f'FROM read_parquet({literal(str(file))}) WHERE NOT stale'
        db.execute(f'CREATE TABLE {KEPT} AS SELECT * EXCLUDE (marker, stale) {kept}')
    except duckdb.Error:
        db.close()
        return None
    return db
