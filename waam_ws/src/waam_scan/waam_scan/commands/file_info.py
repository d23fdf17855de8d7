"""One sentence about a file: what `waam scan info` prints."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ..fusion.quality import enclosed
from ..map_file import FileError, load_map

CLOUDS = ('.pcd', '.ply', '.xyz', '.npy')


def describe(path: Path) -> str:
    """FileError when the file is none of the known kinds or damaged."""
    if not path.is_file():
        raise FileError(f'{path}: no such file')
    if path.suffix == '.npz':
        return _pass(path) if 'pose_stamps' in _names(path) else _map(path)
    if path.suffix.lower() in CLOUDS:
        return _cloud(path)
    raise FileError(
        f'{path}: neither a map or pass (.npz) nor a cloud ({", ".join(CLOUDS)}); of recordings: waam record info, of '
        'logs of others: waam record import'
    )


def _names(path: Path) -> list[str]:
    """Names of the arrays in an NPZ file; empty when it is none."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return list(arrays.files)
    except (OSError, ValueError, EOFError, AttributeError, BadZipFile):
        return []


def _pass(path: Path) -> str:
    from ..calibration.pass_file import load_pass

    p = load_pass(path)
    seen = (np.isfinite(p.x) & np.isfinite(p.z)).mean()
    span = [(a.max() - a.min()) * 1e-9 for a in (p.stamps, p.pose_stamps)]
    return (
        f'pass of {len(p.stamps)} profiles of {p.x.shape[1]} points ({seen:.1%} returns) over {span[0]:.2f} s, '
        f'{len(p.pose_stamps)} poses over {span[1]:.2f} s'
    )


def _cloud(path: Path) -> str:
    from ..registration.clouds import load_points

    points = load_points(path, 1.0)
    low, high = points.min(axis=0), points.max(axis=0)
    spans = ', '.join(f'{n} {a:.2f} .. {b:.2f}' for n, a, b in zip('xyz', low, high, strict=True))
    return f'cloud of {len(points)} points, {spans} (in the unit of the file)'


def _map(path: Path) -> str:
    grid = load_map(path)
    _, holes = enclosed(np.isfinite(grid.z))
    z = grid.z[np.isfinite(grid.z)] * 1e3
    heights = (
        f'{z.min():.3f} .. {z.max():.3f} mm, median {np.median(z):.3f} mm' if z.size else 'none'
    )
    s = grid.spec
    return (
        f'map of {s.rows} x {s.cols} cells of {s.resolution * 1e3:g} mm, '
        f'{grid.coverage:.1%} known, {holes} holes, heights {heights}'
    )
