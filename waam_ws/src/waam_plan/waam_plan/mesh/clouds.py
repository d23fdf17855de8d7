"""Point clouds of a worn surface: read, and turned into a height grid."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import trimesh
from scipy import ndimage

from waam_plan.masks import fill_unknown
from waam_plan.mesh.part import MAX_BYTES, PartError
from waam_process.grid import GridSpec, HeightGrid

FORMATS = ('.pcd', '.xyz', '.csv', '.txt', '.npy')
FEWEST = 100  # points
# m: a cell that stands out of its neighbours' median by more holds spatter or noise
ISOLATED = 2.0e-3


def is_cloud(path: Path | str) -> bool:
    """Whether a file is read as points by its suffix; a PLY is when it has no faces."""
    path = Path(path)
    if path.suffix.lower() == '.ply':
        head = path.read_bytes()[:4096] if path.is_file() else b''
        found = re.search(rb'element\s+face\s+(\d+)', head)
        return bool(head) and (found is None or found.group(1) == b'0')
    return path.suffix.lower() in FORMATS


def read_cloud(path: Path | str, scale: float = 1e-3) -> np.ndarray:
    """(n, 3) finite points, m; scale: m per unit of the file. PartError names file and fault."""
    path = Path(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise PartError(f'{path}: larger than {MAX_BYTES // 1_000_000} MB; thin the cloud out')
        points = _read(path)
    except PartError:
        raise
    except (OSError, ValueError, KeyError, IndexError, EOFError) as error:
        raise PartError(f'{path}: not a readable point cloud ({error})') from error
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < FEWEST:
        raise PartError(f'{path}: {len(points)} finite points are too few for a surface')
    return points * scale


def _read(path: Path) -> np.ndarray:
    kind = path.suffix.lower()
    if kind == '.pcd':
        return _pcd(path.read_bytes())
    if kind == '.npy':
        points = np.load(path, allow_pickle=False)
    elif kind == '.ply':
        points = np.asarray(trimesh.load(path, process=False).vertices)
    elif kind in FORMATS:
        text = re.sub(r'[;,\t]+', ' ', path.read_text(errors='replace'))
        lines = [s for s in text.splitlines() if s.strip() and s.lstrip()[0] in '+-.0123456789']
        points = np.loadtxt(lines, usecols=(0, 1, 2), ndmin=2) if lines else np.zeros((0, 3))
    else:
        raise ValueError(f'known kinds are {", ".join((*FORMATS, ".ply"))}')
    if points.ndim != 2 or points.shape[1] < 3:
        raise ValueError(f'an array of shape {points.shape} holds no points')
    return np.asarray(points[:, :3], float)


def _pcd(data: bytes) -> np.ndarray:
    """Points of a PCD file, text or binary."""
    found = re.search(rb'^DATA (\w+)\s*?\n', data, re.M)
    if not found:
        raise ValueError('there is no DATA line')
    words = {
        line.split()[0]: line.split()[1:]
        for line in data[: found.start()].decode('ascii', 'replace').splitlines()
        if line.split() and not line.startswith('#')
    }
    names = words['FIELDS']
    count = int(words['POINTS'][0])
    body, kind = data[found.end() :], found.group(1)
    columns = [names.index(axis) for axis in 'xyz']
    if kind == b'ascii':
        return np.loadtxt(body.decode('ascii').splitlines(), usecols=columns, ndmin=2)
    if kind != b'binary':
        raise ValueError(f'data are {kind.decode()}; save it as binary or ascii')
    repeat = words.get('COUNT', ['1'] * len(names))
    types = zip(names, words['TYPE'], words['SIZE'], repeat, strict=True)
    kinds = {'F': 'f', 'I': 'i', 'U': 'u'}
    fields = [(f'{n}_{i}', f'<{kinds[t]}{s}', (int(c),)) for i, (n, t, s, c) in enumerate(types)]
    layout = np.dtype(fields)
    stored = [name for name, _, _ in fields]
    if len(body) < count * layout.itemsize:
        raise ValueError(f'truncated: {count} points are announced')
    rows = np.frombuffer(body, layout, count)
    return np.column_stack([rows[stored[c]][:, 0] for c in columns]).astype(float)


def cloud_grid(points: np.ndarray, spec: GridSpec) -> HeightGrid:
    """Median height of the points (n, 3) m in every cell; single cells far off their neighbours are dropped."""
    row, col = spec.cell(points[:, 0], points[:, 1])
    on = spec.contains(points[:, 0], points[:, 1])
    cell = row[on] * spec.cols + col[on]
    z = points[on, 2]
    order = np.lexsort((z, cell))
    cell, z = cell[order], z[order]
    which, first, count = np.unique(cell, return_index=True, return_counts=True)
    middle = (z[first + (count - 1) // 2] + z[first + count // 2]) / 2
    out = np.full(spec.rows * spec.cols, np.nan)
    out[which] = middle
    return HeightGrid(spec, _without_outliers(out.reshape(spec.shape)))


def _without_outliers(z: np.ndarray) -> np.ndarray:
    around = ndimage.median_filter(fill_unknown(z), size=5, mode='nearest')
    return np.where(np.abs(z - around) > ISOLATED, np.nan, z)


def spec_around(points: np.ndarray, margin: float, grid: float) -> GridSpec:
    """Grid over the plan view of points (n, 3) m with a margin (m)."""
    low, high = points[:, :2].min(axis=0) - margin, points[:, :2].max(axis=0) + margin
    return GridSpec.covering(float(low[0]), float(low[1]), float(high[0]), float(high[1]), grid)
