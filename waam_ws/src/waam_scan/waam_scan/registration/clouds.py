"""Clouds, maps and meshes from files, for registration and comparison. All in m; errors name the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..recordings.files import FileError, load_map

CLOUDS = ('.ply', '.pcd', '.xyz')
MESHES = ('.stl', '.obj', '.off')


def load_points(path: Path, scale: float = 1e-3) -> np.ndarray:
    """(n, 3) finite points in m of a PLY, PCD, XYZ or NPY cloud (m per unit: scale) or of a map (.npz, in m)."""
    path = Path(path)
    if not (np.isfinite(scale) and scale > 0):
        raise FileError(f'--scale {scale} must be a positive length in m')
    if path.suffix.lower() == '.npz':
        grid = load_map(path)
        x, y = np.meshgrid(grid.spec.x, grid.spec.y)
        points = np.column_stack([x.ravel(), y.ravel(), grid.z.ravel()])
    else:
        points = _read(path) * scale
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 200:
        raise FileError(f'{path}: only {len(points)} points')
    return points


def _read(path: Path) -> np.ndarray:
    if not path.is_file():
        raise FileError(f'{path}: no such file')
    if path.suffix.lower() == '.npy':
        return _read_npy(path)
    if path.suffix.lower() not in CLOUDS:
        raise FileError(f'{path}: not a cloud; known are .npz maps, .npy, {", ".join(CLOUDS)}')
    import open3d as o3d

    try:
        with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
            cloud = o3d.io.read_point_cloud(str(path), remove_nan_points=True)
    except (MemoryError, RuntimeError) as e:  # the header promises more data than the file has
        raise FileError(f'{path}: damaged ({e})') from None
    points = np.asarray(cloud.points)
    if len(points) == 0:
        raise FileError(f'{path}: no points in it, or damaged')
    return points


def _read_npy(path: Path) -> np.ndarray:
    try:
        points = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as e:
        raise FileError(f'{path}: not a NumPy array: {e}') from None
    if points.ndim != 2 or points.shape[1] < 3 or points.dtype.kind not in 'fiu':
        raise FileError(f'{path}: a cloud is (n, 3) numbers, not {points.shape} {points.dtype}')
    return points[:, :3].astype(float)


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
    import trimesh

    try:
        mesh = trimesh.load(Path(path), force='mesh')
        triangles = np.asarray(mesh.triangles, float) * scale
    except FileNotFoundError:
        raise FileError(f'{path}: no such file') from None
    except Exception as e:  # trimesh's readers raise all kinds of exceptions
        raise FileError(f'{path}: not a mesh that can be read: {e}') from None
    if len(triangles) == 0 or not np.isfinite(triangles).all():
        raise FileError(f'{path}: no triangles in it')
    return triangles


def save_cloud(path: Path, points: np.ndarray) -> None:
    """Writes points (n, 3) m as a binary PLY in mm."""
    import open3d as o3d

    o3d.io.write_point_cloud(
        str(path), o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points * 1e3))
    )
