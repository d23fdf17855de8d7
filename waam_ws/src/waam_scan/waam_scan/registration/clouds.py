"""Clouds, maps and meshes from files, for registration and comparison. All in m; errors name the file."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from waam_plan.mesh.clouds import is_cloud, read_points
from waam_plan.mesh.part import PartError, load_part

from ..map_file import FileError, load_map

MESHES = ('.stl', '.obj', '.off')
FEWEST = 200  # points


def load_points(path: Path, scale: float = 1e-3) -> np.ndarray:
    """(n, 3) finite points in m of a cloud (m per unit: scale) or of a map (.npz, in m).

    Clouds are those of `waam plan`; what is left out of one (marks for "no return", stray points) is said on stderr.
    """
    path = Path(path)
    if not (np.isfinite(scale) and scale > 0):
        raise FileError(f'--scale {scale} must be a positive length in m')
    if path.suffix.lower() == '.npz' and not is_cloud(path):
        grid = load_map(path)
        x, y = np.meshgrid(grid.spec.x, grid.spec.y)
        points = np.column_stack([x.ravel(), y.ravel(), grid.z.ravel()])
        points = points[np.isfinite(points).all(axis=1)]
    else:
        points = _read(path) * scale
    if len(points) < FEWEST:
        raise FileError(f'{path}: only {len(points)} points')
    return points


def _read(path: Path) -> np.ndarray:
    """In units of the file."""
    try:
        cloud, _ = read_points(path)
    except PartError as error:
        raise FileError(str(error)) from None
    for note in cloud.notes:
        print(note, file=sys.stderr)
    return cloud.points


def is_mesh(path: Path) -> bool:
    """Whether a file holds triangles: by its ending; a PLY is one when it has faces."""
    suffix = Path(path).suffix.lower()
    if suffix != '.ply':
        return suffix in MESHES
    try:
        head = Path(path).read_bytes()[:4000].split(b'end_header')[0]
    except OSError as e:
        raise FileError(f'{path}: cannot be read: {e}') from None
    return b'element face' in head and b'element face 0' not in head


def load_triangles(path: Path, scale: float = 1e-3) -> np.ndarray:
    """(n, 3, 3) in m of a mesh file."""
    try:
        return np.asarray(load_part(path, scale, require_closed=False).mesh.triangles, float)
    except PartError as error:
        raise FileError(str(error)) from None


def save_cloud(path: Path, points: np.ndarray) -> None:
    """Writes points (n, 3) m as a binary PLY in mm."""
    import open3d as o3d

    o3d.io.write_point_cloud(
        str(path), o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points * 1e3))
    )
