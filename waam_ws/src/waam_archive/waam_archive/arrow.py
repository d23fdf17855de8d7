"""Rows and arrays become Arrow tables of the schema, and those become Parquet files."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from .content import Row, Surface
from .schema import TABLES

KINDS = {
    'text': pa.string(), 'int': pa.int64(), 'float': pa.float64(), 'bool': pa.bool_(), 'time': pa.timestamp('us'),
    'floats': pa.list_(pa.float32()),
}  # fmt: skip
SCHEMAS = {t: pa.schema([(c.name, KINDS[c.kind]) for c in cs]) for t, cs in TABLES.items()}
TELEMETRY = {
    't_s': 't', 'x_m': 'x', 'y_m': 'y', 'z_m': 'z', 'current_A': 'current', 'voltage_V': 'voltage',
    'wire_feed_m_s': 'wire_feed', 'wire_feed_commanded_m_s': 'wire_feed_commanded', 'speed_m_s': 'speed',
    'temperature_C': 'temperature', 'arc': 'arc', 'layer': 'layer',
}  # fmt: skip


def table(name: str, rows: list[Row]) -> pa.Table:
    """Rows of a small table; columns that a row lacks, and NaN, are NULL."""
    columns = [
        pa.array([r.get(c.name) for r in rows], KINDS[c.kind], from_pandas=True)
        for c in TABLES[name]
    ]
    return pa.Table.from_arrays(columns, schema=SCHEMAS[name])


def telemetry(job: str, track: dict[str, np.ndarray]) -> pa.Table:
    """Table telemetry; NaN is NULL."""
    n = len(next(iter(track.values()), ()))
    schema = SCHEMAS['telemetry']
    columns = [pa.array([job] * n, pa.string())]
    for field in list(schema)[1:]:
        values = np.asarray(track[TELEMETRY[field.name]]) if track else np.empty(0)
        if field.type == pa.bool_():
            values = values > 0.5
        elif field.type == pa.int64():
            values = np.nan_to_num(values).astype(np.int64)
        columns.append(pa.array(values, field.type, from_pandas=True))
    return pa.Table.from_arrays(columns, schema=schema)


def maps(job: str, surfaces: list[Surface]) -> pa.Table:
    """Table maps: one row per map."""
    rows: list[Row] = []
    arrays: list[np.ndarray] = []
    for s in surfaces:
        for name, values in sorted(s.arrays.items()):
            shape = {'rows': values.shape[0], 'cols': values.shape[1], 'resolution_m': s.resolution}
            origin = {'origin_x_m': s.origin[0], 'origin_y_m': s.origin[1]}
            rows.append({'job': job, 'layer': s.layer, 'name': name, **shape, **origin})
            arrays.append(np.asarray(values, np.float32).ravel())
    found = table('maps', rows)
    offsets = np.cumsum([0, *(len(a) for a in arrays)]).astype(np.int32)
    flat = np.concatenate(arrays) if arrays else np.empty(0, np.float32)
    data = pa.ListArray.from_arrays(pa.array(offsets), pa.array(flat))
    return found.set_column(found.num_columns - 1, SCHEMAS['maps'].field('data'), data)


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
