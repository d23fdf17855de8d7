"""A row per job with all figures of a trend, in a file of its own: the next program need not read a million beads.

The file is named by what it was made from (names, times and sizes of all markers, and the question), so it is never
wrong; when the archive has changed another one is made. It holds nothing that the archive does not; it may be deleted.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import duckdb

from .archive import Archive
from .metrics import KEPT, table
from .store import literal

FOLDER = '.figures'
Answer = TypeVar('Answer')


class KeptFigures:
    """Questions to that table. Keeps it in memory as long as nothing is written into the archive."""

    def __init__(self, archive: Archive) -> None:
        self.archive = archive
        self._open: tuple[str, duckdb.DuckDBPyConnection] | None = None

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
        return hashlib.sha256(repr((self.archive.store.stamps(), table())).encode()).hexdigest()[
            :32
        ]

    def _table(self, key: str) -> duckdb.DuckDBPyConnection:
        folder = self.archive.store.root / FOLDER
        file = folder / f'{key}.parquet'
        found = _load(file)
        if found is not None:
            return found
        if self.archive.store.exists and self._write(folder, file, key):
            found = _load(file)
        if found is None:  # the archive may be read only, or its disk full
            with tempfile.TemporaryDirectory() as scratch:
                place = Path(scratch)
                self._write(place, place / 'figures.parquet', key)
                found = _load(place / 'figures.parquet')
        if found is None:
            raise OSError('the figures of the jobs can be written nowhere')
        return found

    def _write(self, folder: Path, file: Path, key: str) -> bool:
        """False when the file is not there: it cannot be written, or somebody writes into the archive."""
        part = folder / f'{key}.{os.getpid()}.part'

        def copy(db: duckdb.DuckDBPyConnection) -> bool:
            db.execute(table())
            try:
                folder.mkdir(exist_ok=True)
                db.execute(f'COPY {KEPT} TO {literal(str(part))} (FORMAT parquet, CODEC zstd)')
            except (OSError, duckdb.Error):
                return False
            return True

        try:
            if not self.archive.ask(('jobs', 'beads'), copy):
                return False
            if folder.name == FOLDER and self._key() != key:
                return False
            os.replace(part, file)
            for other in folder.glob('*.parquet'):
                if other != file:
                    other.unlink(missing_ok=True)
            return True
        except OSError:
            return False
        finally:
            if folder.is_dir():
                part.unlink(missing_ok=True)


def _load(file: Path) -> duckdb.DuckDBPyConnection | None:
    """None when the file is not there or cannot be read."""
    if not file.is_file():
        return None
    db = duckdb.connect(config={'temp_directory': ''})
    try:
        db.execute(f'CREATE TABLE {KEPT} AS SELECT * FROM read_parquet({literal(str(file))})')
    except duckdb.Error:
        db.close()
        return None
    return db
