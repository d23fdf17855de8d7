"""A folder of recordings to maps on disk and the table of bead tops: what `waam scan fuse` does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..recordings.bead import BeadTop, WallError
from ..recordings.files import FileError, read_arc_log, read_laser_csv, save_map
from ..recordings.wall import WallMaps, fuse_wall
from .picture import save_ply, save_png

TABLE_STEP = 5e-3  # m along the wall


def laser_files(folder: Path) -> list[Path]:
    """LaserCoordinateN.csv in the order of N; FileError when there are none or one is missing."""
    if not folder.is_dir():
        raise FileError(f'{folder}: no such folder')
    found = {
        int(m[1]): p
        for p in folder.iterdir()
        if (m := re.fullmatch(r'LaserCoordinate(\d+)\.csv', p.name))
    }
    if not found:
        raise FileError(f'{folder}: no LaserCoordinateN.csv in it')
    numbers = sorted(found)
    missing = sorted(set(range(numbers[0], numbers[-1] + 1)) - set(numbers))
    if missing:
        raise FileError(f'{folder}: LaserCoordinate{missing[0]}.csv is missing')
    return [found[n] for n in numbers]


def fuse_folder(folder: Path, out: Path, cell: float, ply: bool) -> WallMaps:
    """Reads, fuses, writes maps and pictures into `out`, prints the report. Writes nothing when anything is wrong."""
    files = laser_files(folder)
    try:
        wall = fuse_wall(
            [read_laser_csv(p) for p in files], read_arc_log(folder / 'arc_log.csv'), cell
        )
    except WallError as e:
        raise WallError(f'{folder}: {e}') from None
    out.mkdir(parents=True, exist_ok=True)
    tops: list[BeadTop | None] = [None, *wall.tops]
    low, high = -0.5, 1e3 * max(float(t.height.max()) for t in wall.tops) + 0.5
    for number, (fused, top) in enumerate(zip(wall.maps, tops, strict=True)):
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
        title = f'{files[number].name}: ' + (
            f'after layer {number}' if number else 'before layer 1'
        )
        save_png(name.with_suffix('.png'), fused.spec, fused.z, title, (low, high), mark)
        if ply:
            save_ply(name.with_suffix('.ply'), fused.spec, fused.z)
    print('\n'.join(report(folder, files, wall)))
    print(f'maps and pictures: {out}')
    return wall


def report(folder: Path, files: list[Path], wall: WallMaps) -> list[str]:
    """The lines of the report."""
    return [
        f'{folder}: {len(files)} scans',
        *_registration(wall),
        '',
        *_scan_table(files, wall),
        '',
        *_top_table(wall),
        '',
        *_along_table(wall),
    ]


def _registration(wall: WallMaps) -> list[str]:
    lags, speed = np.array(wall.lags), abs(wall.scans[0].motion.speed)
    spread = 0.5 * float(np.ptp(lags))
    return [
        f'  clocks: the arc log is {np.median(lags):.3f} s later than the profiles (scans differ by ± {spread:.3f} s, '
        f'which is ± {spread * speed * 1e3:.1f} mm along the wall)',
        f'  scan speed {speed * 1e3:.1f} mm/s; the scanner is {wall.shift[0] * 1e3:.1f} mm from the torch along x and '
        f'{wall.shift[1] * 1e3:.1f} mm along y (from where the bead lies; the sign of y cannot be told)',
    ]


def _scan_table(files: list[Path], wall: WallMaps) -> list[str]:
    lines = [
        '  scan  file                    profiles  rejected  points  spikes  coverage  scatter mm  substrate mm'
    ]
    first = _level(wall, 0)
    for k, (fused, assembler) in enumerate(zip(wall.maps, wall.assemblers, strict=True)):
        c = assembler.counts
        lines.append(
            f'  {k:4d}  {files[k].name:22s}  {c.used:8d}  {c.rejected:8d}  {fused.points_used:6d}  {fused.spikes:6d}  '
            f'{fused.coverage:8.1%}  {fused.residual * 1e3:10.3f}  {(_level(wall, k) - first) * 1e3:+12.3f}'
        )
    return [*lines, '  (substrate: its level in the robot frame under the bead, against scan 0)']


def _level(wall: WallMaps, k: int) -> float:
    """Substrate under the bead in robot axes (m, up to a constant)."""
    plane, bead = wall.scans[k].plane, wall.bead
    x = 0.5 * (bead.start + bead.end) - wall.shift[0]
    return plane.a + plane.b * x + plane.c * (bead.axis - wall.shift[1])


def _top_table(wall: WallMaps) -> list[str]:
    lines = [
        '  bead top above the substrate, mm (mean over the wall without 8 mm at each end, ± 2 u)'
    ]
    lines.append('  layer    mean   ± 2 u     min     max   rms along wall   growth')
    before = 0.0
    for k, top in enumerate(wall.tops, 1):
        h = top.height[top.inner] * 1e3
        lines.append(
            f'  {k:5d}  {top.mean * 1e3:6.3f}  {2e3 * top.mean_u:6.3f}  {h.min():6.3f}  {h.max():6.3f}  '
            f'{h.std():15.3f}  {(top.mean - before) * 1e3:7.3f}'
        )
        before = top.mean
    return lines


def _along_table(wall: WallMaps) -> list[str]:
    """Bead tops along the wall; each entry is the mean of its 5 mm."""
    first = np.ceil(wall.bead.start / TABLE_STEP) * TABLE_STEP
    edges = np.arange(first, wall.bead.end + 1e-9, TABLE_STEP)
    lines = [
        '  along the wall (mean of 5 mm), mm',
        '  x          ' + ''.join(f'{e * 1e3:5.0f} ' for e in edges[:-1]),
    ]
    for k, top in enumerate(wall.tops, 1):
        cells = []
        for a, b in zip(edges, edges[1:], strict=False):
            inside = (top.x >= a) & (top.x < b)
            cells.append(f'{np.mean(top.height[inside]) * 1e3:5.2f} ' if inside.any() else '    - ')
        lines.append(f'  layer {k:3d}  ' + ''.join(cells))
    return lines
