"""One sentence about a file: what `waam scan info` prints."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ..fusion.quality import enclosed
from ..recordings.files import (
    INPROCESS_HEADER,
    LASER_HEADER,
    FileError,
    load_map,
    read_arc_log,
    read_inprocess_csv,
    read_laser_csv,
    read_text,
)
from ..recordings.left_out import LeftOut


def describe(path: Path, left_out: LeftOut | None = None) -> str:
    """FileError when the file is none of the known kinds or damaged. Damaged lines and profiles go into left_out;
    without it they are an error."""
    if path.suffix == '.npz':
        return _pass(path) if 'pose_stamps' in _names(path) else _map(path)
    if path.suffix.lower() in ('.pcd', '.ply', '.xyz', '.npy'):
        return _cloud(path)
    head = [f.strip() for f in read_text(path).lstrip().split('\n')[0].split('\r')[0].split(',')]
    if head == LASER_HEADER:
        return _laser(path, left_out)
    if head == INPROCESS_HEADER:
        return _inprocess(path, left_out)
    if head[:1] == ['time'] and 'ArcOn' in head:
        return _arc_log(path, left_out)
    raise FileError(f'{path}, line 1: header {",".join(head)[:60]!r} is of no known kind of file')


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
    filled = ', filled holes marked' if 'filled' in _names(path) else ''
    _, holes = enclosed(np.isfinite(grid.z))
    z = grid.z[np.isfinite(grid.z)] * 1e3
    heights = (
        f'{z.min():.3f} .. {z.max():.3f} mm, median {np.median(z):.3f} mm' if z.size else 'none'
    )
    s = grid.spec
    return (
        f'map of {s.rows} x {s.cols} cells of {s.resolution * 1e3:g} mm, '
        f'{grid.coverage:.1%} known, {holes} holes{filled}, heights {heights}'
    )


def _laser(path: Path, left_out: LeftOut | None) -> str:
    scan = read_laser_csv(path, left_out)
    dt = np.diff(scan.stamps) * 1e-9
    points = np.isfinite(scan.x).sum(axis=1)
    rate = f', {1 / np.median(dt):.1f} Hz, longest gap {dt.max():.3f} s' if len(dt) else ''
    return (
        f'{len(points)} profiles of {points.min()} .. {points.max()} points{rate}, '
        f'lateral {np.nanmin(scan.x) * 1e3:.1f} .. {np.nanmax(scan.x) * 1e3:.1f} mm, '
        f'distance {np.nanmin(scan.range) * 1e3:.1f} .. {np.nanmax(scan.range) * 1e3:.1f} mm'
    )


def _inprocess(path: Path, left_out: LeftOut | None) -> str:
    scan = read_inprocess_csv(path, left_out)
    points = np.isfinite(scan.x).sum(axis=1)
    span = scan.t[-1] - scan.t[0]
    rate = f', {(len(points) - 1) / span:.1f} Hz' if span > 0 else ''
    return (
        f'{len(points)} profiles of layer {scan.layer.min()} .. {scan.layer.max()}, '
        f'{points.min()} .. {points.max()} points'
        f'{rate}; no poses, so no map can be made of them'
    )


def _arc_log(path: Path, left_out: LeftOut | None) -> str:
    from ..recordings.wall import find_scans

    log = read_arc_log(path, left_out)
    starts = int((np.diff(log.arc.astype(int), prepend=0) == 1).sum())
    speed = np.mean(log.speed[log.arc]) * 1e3 if log.arc.any() else float('nan')
    return (
        f'{len(log.t)} lines over {log.t[-1] - log.t[0]:.1f} s, '
        f'{starts} arc starts (travel {speed:.1f} mm/s on average), '
        f'{len(find_scans(log))} scanning motions'
    )
