"""A folder of recordings to maps on disk and the table of bead tops: what `waam scan fuse` does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..recordings.bead import BeadTop, WallError
from ..recordings.files import FileError, LaserScan, read_arc_log, read_laser_csv, save_map
from ..recordings.left_out import LeftOut
from ..recordings.wall_maps import WallMaps, fuse_wall
from .picture import save_ply, save_png

TABLE_STEP = 5e-3  # m along the wall


def laser_files(folder: Path, left_out: LeftOut) -> dict[int, Path]:
    """N -> LaserCoordinateN.csv in the order of N; a number that is missing between others goes into left_out.
    FileError when there is no file."""
    if not folder.is_dir():
        raise FileError(f'{folder}: no such folder')
    found = {
        int(m[1]): p
        for p in folder.iterdir()
        if (m := re.fullmatch(r'LaserCoordinate(\d{1,6})\.csv', p.name))
    }
    if not found:
        raise FileError(f'{folder}: no LaserCoordinateN.csv in it')
    numbers = sorted(found)
    for low, high in zip(numbers, numbers[1:], strict=False):
        for n in range(low + 1, min(high, low + 4)):
            left_out.add('scan', folder / f'LaserCoordinate{n}.csv', '', 'is missing')
    return {n: found[n] for n in numbers}


def _read(files: dict[int, Path], left_out: LeftOut) -> dict[int, LaserScan]:
    """What can be read; the rest goes into left_out."""
    lasers = {}
    for n, path in files.items():
        try:
            lasers[n] = read_laser_csv(path, left_out)
        except FileError as e:
            left_out.add('scan', path, '', e)
    return lasers


def fuse_folder(
    folder: Path, out: Path, cell: float, ply: bool, left_out: LeftOut | None = None
) -> WallMaps:
    """Reads, fuses, writes maps and pictures into `out`, prints the report. Profiles and scans that are bad go into
    left_out and the rest goes on. Writes nothing when fewer than two scans are left."""
    left_out = LeftOut() if left_out is None else left_out
    files = laser_files(folder, left_out)
    log = read_arc_log(folder / 'arc_log.csv', left_out)
    lasers = _read(files, left_out)
    if not lasers:
        raise left_out.nothing_left(folder)
    paths = [files[n] for n in lasers]
    try:
        wall = fuse_wall(list(lasers.values()), log, cell, [str(p) for p in paths], left_out)
    except WallError as e:
        more = f' ({left_out.count()} left out: {left_out.items[0]})' if left_out else ''
        raise WallError(f'{folder}: {e}{more}') from None
    numbers = [list(lasers)[k] - min(files) for k in wall.kept]  # layer after which each was taken
    paths = [paths[k] for k in wall.kept]
    out.mkdir(parents=True, exist_ok=True)
    tops: list[BeadTop | None] = [None, *wall.tops]
    low, high = -0.5, 1e3 * max(float(t.height.max()) for t in wall.tops) + 0.5
    for number, path, fused, top in zip(numbers, paths, wall.maps, tops, strict=True):
        name = out / f'scan_{number:03d}'
        save_map(
            name.with_suffix('.npz'),
            fused.spec,
            fused.z,
            fused.sigma,
            fused.count,
            layer=np.array(number),
        )
        mark = None if top is None else (top.x, top.height, top.u)
        title = f'{path.name}: ' + (f'after layer {number}' if number else 'before layer 1')
        save_png(name.with_suffix('.png'), fused.spec, fused.z, title, (low, high), mark)
        if ply:
            save_ply(name.with_suffix('.ply'), fused.spec, fused.z)
    print('\n'.join(report(folder, paths, numbers, wall)))
    print(f'maps and pictures: {out}')
    return wall


def report(folder: Path, files: list[Path], numbers: list[int], wall: WallMaps) -> list[str]:
    """The lines of the report. numbers: of the layer before each scan, 0 = none."""
    return [
        f'{folder}: {len(files)} scans',
        *_registration(wall),
        '',
        *_scan_table(files, numbers, wall),
        '',
        *_top_table(numbers, wall),
        '',
        *_along_table(numbers, wall),
    ]


def _registration(wall: WallMaps) -> list[str]:
    lags = np.array([lag for lag in wall.lags if np.isfinite(lag)] or [wall.scans[0].lag])
    speed = abs(wall.scans[0].motion.speed)
    spread = 0.5 * float(np.ptp(lags))
    return [
        f'  clocks: the arc log is {np.median(lags):.3f} s later than the profiles (scans differ by ± {spread:.3f} s, '
        f'which is ± {spread * speed * 1e3:.1f} mm along the wall)',
        f'  scan speed {speed * 1e3:.1f} mm/s; the scanner is {wall.shift[0] * 1e3:.1f} mm from the torch along x and '
        f'{wall.shift[1] * 1e3:.1f} mm along y (from where the bead lies; the sign of y cannot be told)',
    ]


def _scan_table(files: list[Path], numbers: list[int], wall: WallMaps) -> list[str]:
    lines = [
        '  scan  file                    profiles  rejected  points  spikes  coverage  scatter mm  substrate mm'
    ]
    first = _level(wall, 0)
    for k, (fused, assembler) in enumerate(zip(wall.maps, wall.assemblers, strict=True)):
        c = assembler.counts
        lines.append(
            f'  {numbers[k]:4d}  {files[k].name:22s}  {c.used:8d}  {c.rejected:8d}  {fused.points_used:6d}  '
            f'{fused.spikes:6d}  {fused.coverage:8.1%}  {fused.residual * 1e3:10.3f}  '
            f'{(_level(wall, k) - first) * 1e3:+12.3f}'
        )
    return [
        *lines,
        f'  (substrate: its level in the robot frame under the bead, against scan {numbers[0]})',
    ]


def _level(wall: WallMaps, k: int) -> float:
    """Substrate under the bead in robot axes (m, up to a constant)."""
    plane, bead = wall.scans[k].plane, wall.bead
    x = 0.5 * (bead.start + bead.end) - wall.shift[0]
    return plane.a + plane.b * x + plane.c * (bead.axis - wall.shift[1])


def _top_table(numbers: list[int], wall: WallMaps) -> list[str]:
    lines = [
        '  bead top above the substrate, mm (mean over the wall without 8 mm at each end, ± 2 u)'
    ]
    lines.append('  layer    mean   ± 2 u     min     max   rms along wall   growth')
    before, below = 0.0, 0  # the substrate
    for k, top in zip(numbers[1:], wall.tops, strict=True):
        h = top.height[top.inner] * 1e3
        lines.append(
            f'  {k:5d}  {top.mean * 1e3:6.3f}  {2e3 * top.mean_u:6.3f}  {h.min():6.3f}  {h.max():6.3f}  '
            f'{h.std():15.3f}  {(top.mean - before) * 1e3:7.3f}{_since(k - below)}'
        )
        before, below = top.mean, k
    return lines


def _since(layers: int) -> str:
    return '' if layers == 1 else f' over {layers} layers'


def _along_table(numbers: list[int], wall: WallMaps) -> list[str]:
    """Bead tops along the wall; each entry is the mean of its 5 mm."""
    first = np.ceil(wall.bead.start / TABLE_STEP) * TABLE_STEP
    edges = np.arange(first, wall.bead.end + 1e-9, TABLE_STEP)
    lines = [
        '  along the wall (mean of 5 mm), mm',
        '  x          ' + ''.join(f'{e * 1e3:5.0f} ' for e in edges[:-1]),
    ]
    for k, top in zip(numbers[1:], wall.tops, strict=True):
        cells = []
        for a, b in zip(edges, edges[1:], strict=False):
            inside = (top.x >= a) & (top.x < b)
            cells.append(f'{np.mean(top.height[inside]) * 1e3:5.2f} ' if inside.any() else '    - ')
        lines.append(f'  layer {k:3d}  ' + ''.join(cells))
    return lines
