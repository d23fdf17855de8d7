"""Tables of some jobs as files for other programs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .archive import Archive
from .schema import names
from .selection import Selection
from .store import literal

OPTIONS = {
    'parquet': 'FORMAT parquet, CODEC zstd',
    'csv': 'FORMAT csv, HEADER',
    'json': 'FORMAT json',
}


def export(
    archive: Archive, chosen: Selection, kind: str, tables: Iterable[str], folder: Path
) -> dict[str, int]:
    """Writes one file per table into a new folder; returns the rows of each. ValueError when the folder is there."""
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise ValueError(f'{folder} exists; nothing was written') from None
    where, values = chosen.where()
    return {
        t: _one(archive, t, folder / f'{t}.{kind}', OPTIONS[kind], where, values) for t in tables
    }


def _one(
    archive: Archive, table: str, file: Path, options: str, where: str, values: list[Any]
) -> int:
    columns = ', '.join(f't."{n}"' for n in names(table))
    query = f'SELECT {columns} FROM "{table}" t WHERE job IN (SELECT job FROM jobs WHERE {where})'

    def copy(db: Any) -> int:
        found = db.execute(f'COPY ({query}) TO {literal(str(file))} ({options})', values).fetchone()
        return int(found[0])

    return archive.ask(tuple({table, 'jobs'}), copy)
