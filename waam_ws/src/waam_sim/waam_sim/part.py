"""The work-piece on the table: the top surface of an STL file, a height map or a flat plate, as heights over the table
(m)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from .compiled import jit

MAX_PART_SIZE = 0.5
BEYOND = 16e-3  # m of bare table beyond the ends of a shaft


class PartError(ValueError):
    """A part that cannot be put on the table; the text says which and why."""


def plate(size_x: float, size_y: float, size_z: float, cell: float, margin: float) -> HeightGrid:
    """A flat plate with its corner at the origin of the work frame, table around it."""
    for name, v in (('x', size_x), ('y', size_y), ('z', size_z)):
        if not (math.isfinite(v) and 0.0 < v <= MAX_PART_SIZE):
            text = f'plate.{name} is {v * 1e3:g} mm, must be more than 0 and at most'
            raise PartError(f'{text} {MAX_PART_SIZE * 1e3:g} mm')
    spec = _around(size_x, size_y, cell, margin)
    x, y = np.meshgrid(spec.x, spec.y)
    inside = (x > 0) & (x < size_x) & (y > 0) & (y < size_y)
    return HeightGrid(spec, np.where(inside, size_z, 0.0))


def shaft(length: float, level: float, cell: float, turn: float) -> HeightGrid:
    """An unworn shaft as it is unrolled, its surface at z = `level`, bare beyond both of its ends; two turns, each
    `turn` long (m)."""
    rim = 0.5 * turn
    spec = GridSpec.covering(-rim, -BEYOND, turn + rim, length + BEYOND, cell)
    on = (spec.y > 0) & (spec.y < length)
    return HeightGrid(spec, np.where(on[:, None], level, np.zeros(spec.shape)))


def from_stl(path: str, cell: float, margin: float, tilt: float = 0.0) -> HeightGrid:
    """Top surface of an STL file (mm). Its bounding box is moved to the origin, its lowest point to the table.

    tilt: rad, by which a positioner tilts it towards -x before it is seen from above.
    """
    triangles = _tilted(_read(path), tilt) if tilt else _read(path)
    triangles -= triangles.reshape(-1, 3).min(axis=0)
    size = triangles.reshape(-1, 3).max(axis=0)
    if not (size[:2] > 0).all() or (size > MAX_PART_SIZE).any():
        text = ' x '.join(f'{v * 1e3:.1f}' for v in size)
        raise PartError(
            f'{path}: the part measures {text} mm, at most {MAX_PART_SIZE * 1e3:.0f} mm fit'
        )
    spec = _around(size[0], size[1], cell, margin)
    z = np.full(spec.shape, -1.0)
    rasterise(z, np.ascontiguousarray(triangles), spec.origin_x, spec.origin_y, cell)
    return HeightGrid(spec, np.maximum(z, 0.0))


def from_file(path: str, cell: float, margin: float, tilt: float = 0.0) -> HeightGrid:
    """`from_stl`, or a height map (.npz, m) that is in the work frame already, as it lies on the table."""
    if Path(path).suffix.lower() != '.npz':
        return from_stl(path, cell, margin, tilt)
    try:
        heights = HeightGrid.load_npz(path)
    except Exception as e:  # numpy raises whatever its parsers raise
        raise PartError(f'{path}: not a height map ({e})') from None
    return placed(heights, cell)


def placed(heights: HeightGrid, cell: float) -> HeightGrid:
    """Heights over the table in the work frame (m), on cells of `cell`: the nearest of those given."""
    x0, x1, y0, y1 = heights.spec.extent
    if not np.isfinite(heights.z).all() or (heights.z < 0).any():
        raise PartError('the height map has cells below the table, or without a height')
    if max(x1 - x0, y1 - y0) > 2 * MAX_PART_SIZE or heights.z.max() > MAX_PART_SIZE:
        raise PartError(
            f'the height map is too large: parts up to {MAX_PART_SIZE * 1e3:.0f} mm fit'
        )
    if abs(heights.spec.resolution - cell) < 1e-9:
        return heights
    spec = GridSpec.covering(x0, y0, x1, y1, cell)
    row, col = heights.spec.cell(*np.meshgrid(spec.x, spec.y))
    row, col = row.clip(0, heights.spec.rows - 1), col.clip(0, heights.spec.cols - 1)
    return HeightGrid(spec, heights.z[row, col])


def centre(part: HeightGrid) -> tuple[float, float]:
    """Middle of the area that is covered with metal; of the grid when the table is bare (m)."""
    x, y = np.meshgrid(part.spec.x, part.spec.y)
    metal = part.z > 1e-4
    if not metal.any():
        x0, x1, y0, y1 = part.spec.extent
        return 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    return (
        0.5 * float(x[metal].min() + x[metal].max()),
        0.5 * float(y[metal].min() + y[metal].max()),
    )


def volume(part: HeightGrid) -> float:
    """Metal above the table, m^3."""
    return float(part.z.sum()) * part.spec.resolution**2


def _around(size_x: float, size_y: float, cell: float, margin: float) -> GridSpec:
    rim = math.ceil(margin / cell) * cell
    return GridSpec.covering(-rim, -rim, size_x + rim, size_y + rim, cell)


def _tilted(corners: np.ndarray, tilt: float) -> np.ndarray:
    """(n, 3, 3): z leans to -x and x goes up, by `tilt` rad."""
    x, y, z = np.moveaxis(corners, -1, 0)
    c, s = math.cos(tilt), math.sin(tilt)
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)


def _read(path: str) -> np.ndarray:
    """(n, 3, 3) corners in m."""
    import trimesh

    if not Path(path).is_file():
        raise PartError(f'{path}: no such file')
    try:
        mesh = trimesh.load_mesh(path, file_type='stl', process=False)
        corners = np.array(mesh.triangles, float)
    except Exception as e:
        raise PartError(f'{path}: not a readable STL file ({e})') from None
    if not len(corners):
        raise PartError(f'{path}: the mesh is empty')
    if not np.isfinite(corners).all():
        raise PartError(f'{path}: the mesh has corners that are not finite numbers')
    return corners * 1e-3


@jit
def rasterise(z, triangles, origin_x, origin_y, cell):
    """Raises z (rows, cols) to the top of every triangle (n, 3, 3) over the cell centres; m."""
    rows, cols = z.shape
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if abs(area) < 1e-18:
            continue
        c0 = max(int(math.floor((min(a[0], b[0], c[0]) - origin_x) / cell - 0.5)), 0)
        c1 = min(int(math.ceil((max(a[0], b[0], c[0]) - origin_x) / cell - 0.5)), cols - 1)
        r0 = max(int(math.floor((min(a[1], b[1], c[1]) - origin_y) / cell - 0.5)), 0)
        r1 = min(int(math.ceil((max(a[1], b[1], c[1]) - origin_y) / cell - 0.5)), rows - 1)
        for r in range(r0, r1 + 1):
            y = origin_y + (r + 0.5) * cell
            for k in range(c0, c1 + 1):
                x = origin_x + (k + 0.5) * cell
                u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
                v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
                if u >= -1e-9 and v >= -1e-9 and u + v <= 1.0 + 1e-9:
                    height = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
                    if height > z[r, k]:
                        z[r, k] = height
