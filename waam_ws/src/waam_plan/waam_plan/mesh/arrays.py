"""Points in NumPy files: (n, 3), organised (rows, columns, 3), records with x, y, z, and archives of such arrays."""

from __future__ import annotations

import io
import zipfile
import zlib

import numpy as np

from waam_plan.mesh.text_cloud import INTENSITIES, Table
from waam_plan.texts import shown

MAX_ARRAY_BYTES = 2_000_000_000  # bytes of the arrays of a file
MAP = {'z', 'origin', 'resolution'}  # arrays of a height map
NAMES = ('points', 'xyz', 'cloud', 'vertices')


def read_npy(data: bytes) -> Table:
    """ValueError names the shape or kind that holds no points."""
    return _points(_array(data))


def read_npz(data: bytes) -> Table:
    """An archive with one array, one that is called points, xyz, cloud or vertices, or with x, y and z."""
    held = _members(data)
    if set(held) >= MAP:
        raise ValueError('it is a height map, not a cloud; give it as --as-found')
    if set('xyz') <= set(held):
        x, y, z = (_number(_array(held[a]), a).astype(float) for a in 'xyz')
        if not x.shape == y.shape == z.shape:
            raise ValueError(f'x, y and z have the shapes {x.shape}, {y.shape} and {z.shape}')
        points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        name = next((n for n in INTENSITIES if n in held), '')
        bright = _number(_array(held[name]), name).ravel().astype(float) if name else None
        return Table(points, bright if bright is not None and len(bright) == len(points) else None)
    name = next((n for n in NAMES if n in held), '')
    if not name and len(held) != 1:
        raise ValueError(
            f'none of its arrays ({", ".join(map(shown, sorted(held)))[:80]}) is called points, or x, y and z'
        )
    return _points(_array(held[name or next(iter(held))]))


def is_map(data: bytes) -> bool:
    """Whether an archive is a height map (z, origin, resolution)."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as z:
            return {f'{name}.npy' for name in MAP} <= set(z.namelist())
    except (zipfile.BadZipFile, OSError, ValueError):
        return False


def _members(data: bytes) -> dict[str, bytes]:
    out: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as z:
            if sum(i.file_size for i in z.infolist()) > MAX_ARRAY_BYTES:
                raise ValueError(f'its arrays are larger than {MAX_ARRAY_BYTES // 1_000_000} MB')
            for info in z.infolist():
                if info.filename.endswith('.npy'):
                    with z.open(info) as f:
                        out[info.filename[:-4]] = f.read(info.file_size)
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        NotImplementedError,
        RuntimeError,
        OSError,
    ) as e:
        raise ValueError(f'not a readable archive ({e})') from e
    return out


def _array(data: bytes) -> np.ndarray:
    """The array, after its header was compared with the bytes that are there."""
    f = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(f)
        read = {(1, 0): np.lib.format.read_array_header_1_0}.get(
            version, np.lib.format.read_array_header_2_0
        )
        shape, fortran, kind = read(f)
    except (
        Exception
    ) as e:  # numpy reads the header with Python's own parser, which raises all kinds
        raise ValueError(f'not a NumPy array ({shown(str(e))})') from None
    if kind.hasobject:
        raise ValueError('an array of Python objects is not read; save numbers')
    count, rest = 1, len(data) - f.tell()
    for n in shape:
        count *= int(n)
    if count < 0 or count * kind.itemsize > rest:
        raise ValueError(
            f'truncated: an array of shape {shape} is announced, {rest} bytes are there'
        )
    flat = np.frombuffer(data, kind, count, f.tell()) if count else np.zeros(0, kind)
    return flat.reshape(shape, order='F' if fortran else 'C')


def _number(a: np.ndarray, name: str) -> np.ndarray:
    if a.dtype.kind not in 'fiu':
        raise ValueError(f'{name} holds {a.dtype}, not numbers')
    return a


def _points(a: np.ndarray) -> Table:
    if a.dtype.names:
        missing = [axis for axis in 'xyz' if axis not in a.dtype.names]
        if missing:
            raise ValueError(f'records of {", ".join(a.dtype.names)[:60]}: no {", ".join(missing)}')
        flat = a.ravel()
        columns = [_number(flat[n], n) for n in 'xyz']
        name = next((n for n in INTENSITIES if n in a.dtype.names), '')
        bright = _number(flat[name], name).astype(float) if name else None
        return Table(np.column_stack(columns).astype(float), bright)
    _number(a, 'the array')
    if a.ndim not in (2, 3) or a.shape[-1] < 3 or (a.ndim == 2 and a.shape[0] == 3 < a.shape[1]):
        raise ValueError(
            f'an array of shape {a.shape} holds no points; (n, 3) or (rows, columns, 3) is read'
        )
    if a.shape[-1] > 16:
        raise ValueError(f'an array of shape {a.shape} is a picture or a map, no points')
    notes = []
    if a.shape[-1] > 3:
        notes.append(f'the first 3 of {a.shape[-1]} columns are taken as x y z')
    return Table(a.reshape(-1, a.shape[-1])[:, :3].astype(float), None, '', notes)
