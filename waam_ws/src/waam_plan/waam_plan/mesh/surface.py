"""Mesh -> height grid: the highest z over each cell centre."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

if TYPE_CHECKING:
    import trimesh

CHUNK = 2_000_000  # pairs of triangle and cell looked at together
EDGE = 1e-9  # a cell centre this close (share of a triangle) outside an edge still counts


def top_surface(
    mesh: trimesh.Trimesh, spec: GridSpec, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> HeightGrid:
    """Highest z (m) of a mesh over every cell centre, NaN where the mesh has nothing above the cell.

    mesh: anything with `triangles` (n, 3, 3) in m (a trimesh); offset: added to its coordinates, m.
    Exact at cell centres: each triangle's plane is evaluated there. Vertical faces have no top and are left out. NaN as
    well where faces are missing (`behind`).
    """
    z, through = _tops(mesh, spec, offset)
    return HeightGrid(spec, np.where(through, np.nan, z))


def behind(
    mesh: trimesh.Trimesh, spec: GridSpec, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """(rows, cols) bool: where faces are missing in a mesh that has an inside, so that one looks through the hole at
    the far side from within. Arguments as of `top_surface`."""
    return _tops(mesh, spec, offset)[1]


def _tops(
    mesh: trimesh.Trimesh, spec: GridSpec, offset: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Highest z (m, NaN = nothing) and whether the face there is seen from its back, (rows, cols) each.

    A closed mesh has no back to be seen, however it is wound. Of an open one the way round that most of its top has is
    the outside.
    """
    is_open = not getattr(mesh, 'is_watertight', True)
    if is_open and not mesh.is_winding_consistent:
        from trimesh.repair import fix_winding

        mesh = mesh.copy()
        fix_winding(mesh)
    triangles = np.asarray(mesh.triangles, float) + np.asarray(offset, float)
    up, down = np.full((2, spec.rows * spec.cols), -np.inf)
    for cell, height, upwards in _hits(triangles, spec):
        np.maximum.at(up, cell[upwards], height[upwards])
        np.maximum.at(down, cell[~upwards], height[~upwards])
    top = np.maximum(up, down)
    seen = np.isfinite(top)
    backs = down > up
    if backs.sum() > seen.sum() / 2:
        backs = up > down
    z = np.where(seen, top, np.nan).reshape(spec.shape)
    return z, (backs & seen & is_open).reshape(spec.shape)


def _hits(
    triangles: np.ndarray, spec: GridSpec
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Flat cell indices and heights of the cell centres under each triangle, and whether it looks up, in chunks."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    twice_area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (
        c[:, 0] - a[:, 0]
    )
    col0, col1 = _span(triangles[:, :, 0], spec.origin_x, spec.resolution, spec.cols)
    row0, row1 = _span(triangles[:, :, 1], spec.origin_y, spec.resolution, spec.rows)
    pairs = np.maximum(col1 - col0, 0) * np.maximum(row1 - row0, 0)
    use = np.flatnonzero((pairs > 0) & (np.abs(twice_area) > 1e-18))
    done = np.concatenate([[0], np.cumsum(pairs[use])])
    first = 0
    while first < len(use):
        last = max(first + 1, int(np.searchsorted(done, done[first] + CHUNK, 'right')) - 1)
        t = np.repeat(use[first:last], pairs[use[first:last]])
        k = np.arange(len(t)) - np.repeat(done[first:last] - done[first], pairs[use[first:last]])
        width = (col1 - col0)[t]
        row, col = row0[t] + k // width, col0[t] + k % width
        x = spec.origin_x + (col + 0.5) * spec.resolution
        y = spec.origin_y + (row + 0.5) * spec.resolution
        wb = (
            (x - a[t, 0]) * (c[t, 1] - a[t, 1]) - (y - a[t, 1]) * (c[t, 0] - a[t, 0])
        ) / twice_area[t]
        wc = (
            (b[t, 0] - a[t, 0]) * (y - a[t, 1]) - (b[t, 1] - a[t, 1]) * (x - a[t, 0])
        ) / twice_area[t]
        inside = (wb >= -EDGE) & (wc >= -EDGE) & (wb + wc <= 1 + EDGE)
        height = a[t, 2] + wb * (b[t, 2] - a[t, 2]) + wc * (c[t, 2] - a[t, 2])
        yield (row * spec.cols + col)[inside], height[inside], twice_area[t][inside] > 0
        first = last


def _span(
    coordinate: np.ndarray, origin: float, resolution: float, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """First and one-past-last cell whose centre lies within each triangle's range (n, 3), clipped to the grid."""
    low = (coordinate.min(axis=1) - origin) / resolution - 0.5
    high = (coordinate.max(axis=1) - origin) / resolution - 0.5
    first = np.clip(np.ceil(low - 1e-6), 0, count).astype(np.int64)
    last = np.clip(np.floor(high + 1e-6) + 1, 0, count).astype(np.int64)
    return first, last
