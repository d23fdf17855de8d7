"""Recorded passes and clouds to maps on disk: what `waam scan fuse FILE ...` does."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from waam_process.grid import GridSpec

from ..calibration.pass_file import load_pass
from ..calibration.scan_pass import Pass
from ..fusion.height_map import FusedMap, Fusion
from ..fusion.limits import FusionLimits
from ..fusion.quality import assess
from ..left_out import LeftOut
from ..map_file import FileError, save_map
from ..registration.clouds import load_points
from ..scan_records import passes, recorded_mounting
from ..stream.poses import PoseTrack
from ..stream.profiles import ProfileBlock
from ..stream.session import Session
from ..transform import Mounting
from .picture import save_ply, save_png

CLOUDS = ('.pcd', '.ply', '.xyz', '.npy')
MAX_MAP_CELLS = 4_000_000  # cells of a map
MAX_GAP_NS = 100_000_000  # between two recorded poses
BLOCK = 4096  # profiles per step
MARGIN = 1e-3  # m of height beyond the points


def grid_around(low: np.ndarray, high: np.ndarray, cell: float) -> GridSpec:
    """The grid of `cell` (m) over the corners low, high (>= 2,), its lines at multiples of the cell."""
    if not (np.isfinite(low[:2]).all() and np.isfinite(high[:2]).all()):
        raise ValueError('no point with finite coordinates')
    corner = np.floor(low[:2] / cell) * cell
    cells = np.prod(np.floor((high[:2] - corner) / cell) + 1)
    if cells > MAX_MAP_CELLS:
        raise ValueError(
            f'{(high[0] - low[0]) * 1e3:.0f} x {(high[1] - low[1]) * 1e3:.0f} mm in cells of {cell * 1e3:g} mm are '
            f'{cells:.0f} cells, limit {MAX_MAP_CELLS} (unit of the file wrong? see --scale)'
        )
    return GridSpec.covering(corner[0], corner[1], high[0] + 1e-9, high[1] + 1e-9, cell)


def fuse_cloud(points: np.ndarray, cell: float) -> FusedMap:
    """A map of points (n, 3) in m, work axes, NaN points left out; heights as they are."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise ValueError('no finite point')
    low, high = points.min(axis=0), points.max(axis=0)
    limits = FusionLimits(float(low[2]) - MARGIN, float(high[2]) + MARGIN)
    fusion = Fusion(grid_around(low, high, cell), Mounting(np.zeros(3), np.eye(3)), limits, 2)
    for k in range(0, len(points), BLOCK):
        part = points[k : k + BLOCK]
        nothing = np.zeros((len(part), 1), np.float32)
        fusion.add(part, nothing, nothing)  # every point is a profile of its own
    return fusion.result()


def fuse_passes(
    passes: list[Pass], mounting: Mounting, cell: float
) -> tuple[FusedMap, list[Session]]:
    """One map of all passes, whatever their direction, and how the profiles of each were used."""
    boxes = [_box(p, mounting) for p in passes]
    low = np.nanmin([b[0] for b in boxes], axis=0)
    high = np.nanmax([b[1] for b in boxes], axis=0)
    limits = FusionLimits(float(low[2]) - MARGIN, float(high[2]) + MARGIN)
    fusion = Fusion(grid_around(low, high, cell), mounting, limits, 2)
    used = []
    for p in passes:
        session = Session(fusion, _track(p), MAX_GAP_NS, max_waiting=2**31)
        for k in range(0, len(p.stamps), BLOCK):
            s = slice(k, k + BLOCK)
            x, z = (np.ascontiguousarray(a[s], np.float32) for a in (p.x, p.z))
            session.add(ProfileBlock(p.stamps[s], x, z))
        session.close()
        used.append(session)
    return fusion.result(), used


def _track(p: Pass) -> PoseTrack:
    track = PoseTrack(max(2, len(p.pose_stamps)))
    for t, position in zip(p.pose_stamps, p.poses, strict=True):
        track.append(int(t), *map(float, position))
    return track


def _box(p: Pass, mounting: Mounting) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,) that hold all points, from the extremes of poses and profiles; robust against single spikes in z."""
    good = np.isfinite(p.x) & np.isfinite(p.z)
    if not good.any():
        raise ValueError('not a single return in it')
    xs = np.array([p.x[good].min(), p.x[good].max()])
    zs = np.percentile(p.z[good], [0.1, 99.9]) + np.array([-2e-3, 2e-3])
    corners = np.array([[x, z] for x in xs for z in zs])
    offsets = corners @ mounting.rotation[:, [0, 2]].T
    origins = mounting.origins(p.poses)
    return origins.min(axis=0) + offsets.min(axis=0), origins.max(axis=0) + offsets.max(axis=0)


def check_paths(paths: list[Path]) -> None:
    """FileError names a path that is not there, or a file that is of no known kind: before any work is done."""
    for path in paths:
        if not path.exists():
            raise FileError(f'{path}: no such file or folder')
        if not path.is_dir() and path.suffix.lower() not in (*CLOUDS, '.npz', '.mcap'):
            raise FileError(
                f'{path}: neither a recording (folder, .mcap), a pass (.npz) nor a cloud ({", ".join(CLOUDS)})'
            )


def fuse_files(
    paths: list[Path], out: Path, cell: float, options: argparse.Namespace, left_out: LeftOut
) -> int:
    """Passes (.npz) into one map, clouds into one map each; writes NPZ and PNG, prints what they are worth. What is bad
    goes into left_out. Returns the number of maps.

    options: scale (m per unit of clouds), mounting (None: the default), ply (bool).
    """
    made = 0
    for path in [p for p in paths if p.suffix.lower() in CLOUDS]:
        try:
            write(out / path.stem, fuse_cloud(load_points(path, options.scale), cell), options)
            made += 1
        except ValueError as e:
            left_out.add('scan', path, '', e)
    mounting = options.mounting or Mounting()
    good: dict[Path, Pass] = {}
    for path in [p for p in paths if p.suffix.lower() == '.npz']:
        try:
            good[path] = usable(load_pass(path), path, mounting, left_out)
        except ValueError as e:
            left_out.add('scan', path, '', e)
    if good:
        fused, used = fuse_passes(list(good.values()), mounting, cell)
        for path, session in zip(good, used, strict=True):
            _tell(path, session)
            if not session.counts.used:
                why = '; '.join(session.counts.reasons())
                left_out.add('scan', path, '', f'not one profile could be used: {why}')
        if fused.points_used:
            write(out / next(iter(good)).stem, fused, options)
            made += 1
        elif not left_out:
            left_out.add('scan', next(iter(good)), '', 'not one usable point')
    return made


def usable(p: Pass, name: Path | str, mounting: Mounting, left_out: LeftOut) -> Pass:
    """The pass without its profiles of one point, which no neighbour supports; they go into left_out. ValueError when
    no other profile with a point is left."""
    points = (np.isfinite(p.x) & np.isfinite(p.z)).sum(axis=1)
    single = points == 1
    if points.sum() == 1:
        raise ValueError('only one point in it')
    if p.x.shape[1] == 1 or not single.any():  # a scanner of one point is no damage
        _box(p, mounting)
        return p
    if not (points > 1).any():
        raise ValueError(f'none of its {len(points)} profiles has more than one point')
    for k in np.flatnonzero(single):
        left_out.add('profile', name, f'profile {k}', 'only one point')
    return replace(p, stamps=p.stamps[~single], x=p.x[~single], z=p.z[~single])


def fuse_record(
    path: Path, out: Path, cell: float, options: argparse.Namespace, left_out: LeftOut
) -> int:
    """Every scan of a recorded job into a map of its own, scan_000 ...; options as in `fuse_files`, mounting None:
    that of the job. What is bad goes into left_out. Returns the number of maps."""
    mounting = options.mounting or recorded_mounting(path)
    made = 0
    for scan in passes(path, left_out=left_out):
        try:
            good = usable(scan, scan.name, mounting, left_out)
            fused, used = fuse_passes([good], mounting, cell)
            _tell(scan.name, used[0])
            number = scan.name.rpartition(' ')[2]
            write(out / f'scan_{int(number):03}', fused, options)
            made += 1
        except ValueError as e:
            left_out.add('scan', scan.name, '', e)
    return made


def _tell(name: Path | str, session: Session) -> None:
    c = session.counts
    words = '; '.join(c.reasons() + c.remarks())
    print(f'{name}: {c.used} profiles used, {c.rejected} rejected{": " * bool(words)}{words}')


def write(name: Path, fused: FusedMap, options: argparse.Namespace) -> None:
    """name.npz, name.png and, when asked, name.ply; with the quality of the map on the screen."""
    if fused.points_used == 0:
        raise FileError(f'{name.name}: not one usable point')
    name.parent.mkdir(parents=True, exist_ok=True)
    spec, z = fused.spec, fused.z
    save_map(name.with_suffix('.npz'), spec, z, fused.sigma, fused.count)
    save_png(name.with_suffix('.png'), spec, z, name.name)
    if options.ply:
        save_ply(name.with_suffix('.ply'), spec, z)
    print(
        f'{name}: {spec.rows} x {spec.cols} cells of {spec.resolution * 1e3:g} mm, {fused.coverage:.1%} known, '
        f'{fused.points_used} points used, {fused.spikes} spikes, scatter {fused.residual * 1e3:.4f} mm'
    )
    for line in assess(fused).lines():
        print(f'  {line}')
