"""Scan fusion on what others recorded (`../shared/data`; skipped with a line on stderr where it is not there).

scan.wall_profile_mm: median absolute difference between our crest of the `wall_scan` cloud and its authors' height
  profile, after one constant (their zero is not in the files), against the limit that it must keep.
scan.bead_top_2u_mm: expanded uncertainty of the mean bead top of the three layers of `wall_profiles`, against the
  scatter of the recorded heights along the wall; the heights are in the line.
scan.inprocess_noise_mm: noise of the filtered bead height of `inprocess_profiles` against the series beside it; spikes,
  lag-1 correlation and delay of both are in the line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from lib.emit import emit
from lib.paths import DATA

LIMIT = 0.1  # mm, must be kept


def wall_profile() -> None:
    """The crest of the fused cloud."""
    from waam_scan.registration.clouds import load_points
    from waam_scan.registration.compare_profile import crest, level

    theirs = np.load(DATA / 'wall_scan' / 'x_1610_height_profile.npy') * 1e-3
    ours = crest(level(load_points(DATA / 'wall_scan' / 'x_1610_cloud.pcd')), theirs[:, 0])
    both = np.isfinite(ours)
    difference = 1e3 * (theirs[both, 1] - ours[both])
    constant = float(np.median(difference))
    value = float(np.median(np.abs(difference - constant)))
    note = f'limit; {both.sum()} places, after a constant of {constant:.2f} mm'
    emit('scan.wall_profile_mm', value, 'mm', note, LIMIT)


def bead_tops() -> None:
    """Raw profiles and the robot's log: direction, pose and clock come out of the data."""
    from waam_scan.commands.wall_report import laser_files
    from waam_scan.recordings.files import read_arc_log, read_laser_csv
    from waam_scan.recordings.wall_maps import fuse_wall

    folder = DATA / 'wall_profiles'
    scans = [read_laser_csv(p) for p in laser_files(folder)]
    wall = fuse_wall(scans, read_arc_log(folder / 'arc_log.csv'), 1e-3)
    for number, top in enumerate(wall.tops, 1):
        note = f'rms along the wall; layer {number}, mean bead top {top.mean * 1e3:.3f} mm'
        emit(
            'scan.bead_top_2u_mm',
            2e3 * top.mean_u,
            'mm',
            note,
            1e3 * float(top.height[top.inner].std()),
        )


def inprocess() -> None:
    """Beside the burning arc."""
    from waam_scan.commands.inprocess_report import compared
    from waam_scan.recordings.files import read_inprocess_csv
    from waam_scan.recordings.inprocess import filter_scan

    (file,) = sorted((DATA / 'inprocess_profiles').glob('*.csv'))
    found = compared(filter_scan(read_inprocess_csv(file)))
    ours = found.pop('filtered')
    for name, q in found.items():
        emit(
            'scan.inprocess_noise_mm', ours.noise * 1e3, 'mm',
            f'{name}; spikes {ours.spikes} against {q.spikes}, lag-1 correlation {ours.lag1:.2f} against '
            f'{q.lag1:.2f}, delay {ours.delay * 1e3:.0f} against {q.delay * 1e3:.0f} ms', q.noise * 1e3,
        )  # fmt: skip


def where_recorded(folder: str, measure: Callable[[], None]) -> Callable[[], None]:
    """The measurement; without the recordings it says so and prints nothing."""

    def run() -> None:
        if (DATA / folder).is_dir():
            measure()
        else:
            print(f'{folder}: not in {DATA.name}, skipped', file=sys.stderr)

    return run


FIGURES = {
    'scan.wall_profile_mm': where_recorded('wall_scan', wall_profile),
    'scan.bead_top_2u_mm': where_recorded('wall_profiles', bead_tops),
    'scan.inprocess_noise_mm': where_recorded('inprocess_profiles', inprocess),
}
