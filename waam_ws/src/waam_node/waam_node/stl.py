"""Bodies under a height field as STL files: the demo's part, and small parts for tests and benches."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np


def block(top: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Closed body below a height field: (n, 3, 3) triangles, outward normals. top: (len(y), len(x)), floor at z = 0."""
    grid = np.stack([*np.meshgrid(x, y), top], axis=-1)
    floor = grid.copy()
    floor[..., 2] = 0.0

    def quads(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
        return np.concatenate([np.stack([a, b, c], -2), np.stack([a, c, d], -2)]).reshape(-1, 3, 3)

    def sheet(g: np.ndarray, up: bool) -> np.ndarray:
        corners = (g[:-1, :-1], g[:-1, 1:], g[1:, 1:], g[1:, :-1])
        a, b, c, d = corners if up else corners[::-1]
        return quads(a, b, c, d)

    def wall(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
        return quads(lower[:-1], lower[1:], upper[1:], upper[:-1])

    sides = [
        wall(grid[0], floor[0]),
        wall(grid[:, -1], floor[:, -1]),
        wall(grid[-1, ::-1], floor[-1, ::-1]),
        wall(grid[::-1, 0], floor[::-1, 0]),
    ]
    return np.concatenate([sheet(grid, True), sheet(floor, False), *sides])


def write_stl(path: Path, triangles: np.ndarray, title: str) -> None:
    """Binary STL; triangles (n, 3, 3) in mm."""
    record = np.zeros(
        len(triangles), np.dtype([('n', '<f4', 3), ('v', '<f4', (3, 3)), ('a', '<u2')])
    )
    record['v'] = triangles
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    record['n'] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    path.write_bytes(
        title.encode()[:80].ljust(80) + struct.pack('<I', len(triangles)) + record.tobytes()
    )


def write_worn_block(
    folder: Path, x: np.ndarray, y: np.ndarray, height: float, dip: np.ndarray
) -> tuple[Path, Path]:
    """A block with a flat top, and the same as worn: nominal.stl and worn.stl. All in mm.

    x, y: (n,) and (m,) places along the edges, from the lower corner on; dip: (m, n) what is missing from the top.
    """
    folder.mkdir(parents=True, exist_ok=True)
    nominal, worn = folder / 'nominal.stl', folder / 'worn.stl'
    write_stl(nominal, block(np.full((2, 2), height), x[[0, -1]], y[[0, -1]]), 'nominal')
    write_stl(worn, block(height - dip, x, y), 'worn')
    return nominal, worn
