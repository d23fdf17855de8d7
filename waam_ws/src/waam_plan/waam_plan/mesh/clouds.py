"""Point clouds of a worn surface: read, and turned into a height grid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from waam_plan.masks import fill_unknown
from waam_plan.mesh import arrays, ply
from waam_plan.mesh.no_return import usable
from waam_plan.mesh.part import MAX_BYTES, PartError
from waam_plan.mesh.pcd import read_pcd
from waam_plan.mesh.text_cloud import Table, read_table
from waam_plan.mesh.units import UNITS, wrong_size
from waam_plan.texts import text_of
from waam_process.grid import GridSpec, HeightGrid

FORMATS = ('.pcd', '.xyz', '.csv', '.txt', '.npy')
FEWEST = 100  # points
# m: a cell that stands out of its neighbours' median by more holds spatter or noise
ISOLATED = 2.0e-3


@dataclass(frozen=True)
class Cloud:
    """points: (n, 3), in m where nothing else is said, finite, without marks for "no return".

    notes: what was left out or assumed, for a person.
    """

    points: np.ndarray
    notes: list[str]


def is_cloud(path: Path | str) -> bool:
    """Whether a file is read as points: by its suffix, a PLY without faces, an NPZ that is no height map."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in ('.ply', '.npz') and path.is_file():
        if suffix == '.npz':
            return not arrays.is_map(path.read_bytes())
        with path.open('rb') as f:
            return ply.is_points(f.read(ply.HEAD))
    return suffix in FORMATS


def read_cloud(path: Path | str, scale: float = 1e-3) -> Cloud:
    """scale: m per unit of the file. PartError names file, fault, place and remedy."""
    path = Path(path)
    if not (np.isfinite(scale) and scale > 0):
        raise PartError(f'scale is {scale}, must be a positive length in m per unit of the file')
    cloud, unit = read_points(path)
    if unit and not np.isclose(UNITS[unit], scale):
        raise PartError(
            f'{path}: the header says {unit}, the scale is {scale:g} m per unit; '
            f'give --scale {UNITS[unit]:g}'
        )
    if len(cloud.points) < FEWEST:
        said = f' ({"; ".join(cloud.notes)})' if cloud.notes else ''
        raise PartError(f'{path}: {len(cloud.points)} points are too few for a surface{said}')
    size = float(np.ptp(cloud.points[:, :2], axis=0).max()) * scale
    if wrong := wrong_size(size, scale, 'cloud'):
        raise PartError(f'{path}: {wrong}')
    return Cloud(cloud.points * scale, cloud.notes)


def read_points(path: Path) -> tuple[Cloud, str]:
    """The cloud in units of the file, and the unit that its header says ('' = none). PartError names file and fault."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise PartError(f'{path}: larger than {MAX_BYTES // 1_000_000} MB; thin the cloud out')
        with np.errstate(all='ignore'):  # numbers beyond all bounds are dropped or refused
            table = _read(path)
            points, notes = usable(table.points, table.intensity)
    except FileNotFoundError:
        raise PartError(f'{path}: no such file') from None
    except (OSError, ValueError, MemoryError, OverflowError) as error:
        if isinstance(error, PartError):
            raise
        raise PartError(f'{path}: not a readable point cloud ({error})') from error
    return Cloud(points, [f'{path.name}: {text}' for text in (*table.notes, *notes)]), table.unit


def _read(path: Path) -> Table:
    kind, data = path.suffix.lower(), path.read_bytes()
    if not data:
        raise PartError(f'{path}: the file is empty')
    if kind == '.pcd':
        return read_pcd(data)
    if kind == '.npy':
        return arrays.read_npy(data)
    if kind == '.npz':
        return arrays.read_npz(data)
    if kind == '.ply':
        return ply.read_points(data)
    if kind in FORMATS:
        return read_table(text_of(data))
    raise ValueError(f'not a cloud; known kinds are {", ".join((*FORMATS, ".ply", ".npz"))}')


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
