"""Rows and arrays become Arrow tables of the schema, and those become Parquet files."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from .content import Row
from .schema import TABLES

KINDS = {
    'text': pa.string(), 'int': pa.int64(), 'float': pa.float64(), 'bool': pa.bool_(), 'time': pa.timestamp('us'),
    'floats': pa.list_(pa.float32()),
}  # fmt: skip
SCHEMAS = {t: pa.schema([(c.name, KINDS[c.kind]) for c in cs]) for t, cs in TABLES.items()}


def table(name: str, rows: list[Row]) -> pa.Table:
    """Rows of a small table; columns that a row lacks, and NaN, are NULL."""
    columns = [
        pa.array([r.get(c.name) for r in rows], KINDS[c.kind], from_pandas=True)
        for c in TABLES[name]
    ]
    return pa.Table.from_arrays(columns, schema=SCHEMAS[name])


def write(path: Path, found: pa.Table) -> dict[str, str | int]:
    """A Parquet file that is on the disk when this returns; what a marker says about it."""
    pq.write_table(found, path, compression='zstd', compression_level=1)
    return {**sealed(path), 'rows': found.num_rows}


def sealed(path: Path) -> dict[str, str | int]:
    """Hash and size of a file, once it is on the disk."""
    with open(path, 'rb') as f:
        os.fsync(f.fileno())
        digest = hashlib.file_digest(f, 'sha256').hexdigest()
    return {'sha256': digest, 'bytes': path.stat().st_size}


def rows_of(path: Path) -> int:
    """Number of rows of a Parquet file. OSError or ValueError when it is damaged."""
    return pq.read_metadata(path).num_rows


def names_of(path: Path) -> list[str]:
    """Names of the columns. OSError or ValueError when the file is damaged."""
    return list(pq.read_schema(path).names)


def columns_of(path: Path, columns: tuple[str, ...]) -> list[Row]:
    """These columns, row by row. OSError or ValueError when the file is damaged."""
    return pq.read_table(path, columns=list(columns)).to_pylist()
