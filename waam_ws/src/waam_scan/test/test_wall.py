"""A made-up recording with known clocks, mounting and heights must come out right; the real one must make sense."""

import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from waam_scan.recordings.bead import WallError, crown
from waam_scan.recordings.files import load_map, read_arc_log, read_laser_csv
from waam_scan.recordings.wall import fit_substrate, restore_times
from waam_scan.recordings.wall_maps import fuse_wall

DATA = Path(__file__).resolve().parents[5] / 'shared/data/wall_profiles'
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f'no recordings at {DATA}')
SPEED, LAG, SHIFT = 0.04, 1.7, (0.015, -0.004)  # m/s, s, m
TILT = (0.01, -0.02)  # substrate slopes in robot axes
LAYERS = (0.0, 2.2e-3, 4.1e-3)
WALL_X, WALL_Y = (0.30, 0.36), 0.50


def bead(x, y, height):
    """m above the substrate: parabolic section 6 mm wide, rounded ends."""
    end = np.clip(np.minimum(x - WALL_X[0], WALL_X[1] - x) / 3e-3, 0, 1)
    return height * np.sqrt(end) * np.clip(1 - ((y - WALL_Y) / 3e-3) ** 2, 0, None)


def robot(scan: int):
    """Times and positions of the tcp: rest, scan along -x, lift, weld along +x."""
    t0 = 100.0 + 40 * scan
    knots_t = [t0, t0 + 1, t0 + 1 + 0.12 / SPEED]
    knots = [(0.38, 0.5, 0.06), (0.38, 0.5, 0.06), (0.26, 0.5, 0.06)]
    knots_t += [knots_t[-1] + 0.2, knots_t[-1] + 2, knots_t[-1] + 12]
    knots += [(0.26, 0.5, 0.085), (0.30, 0.5, 0.03), (0.36, 0.5, 0.03)]
    return np.array(knots_t), np.array(knots)


def write_recording(folder: Path, seed=0, arc_off: bool = False) -> None:
    """In the formats of the real recording: 19.6 Hz log truncated to 0.1 s, 50 Hz profiles of 180 points."""
    rng = np.random.default_rng(seed)
    lines = ['time, x, y, z, speed, ArcOn, WFS, I, U']
    for scan, height in enumerate(LAYERS):
        kt, kp = robot(scan)
        for t in np.arange(kt[0], kt[-1], 0.0509):
            p = [np.interp(t, kt, kp[:, i]) * 1e3 for i in range(3)]
            scanning = kt[1] < t < kt[2]
            welding = t > kt[-2] and not arc_off
            speed = SPEED * 60 if scanning else 0.36
            stamp = np.floor(t * 10 + 1e-6) / 10
            lines.append(
                f'{int(stamp // 60):02d}:{stamp % 60:04.1f},{p[0]:.3f},{p[1]:.3f},{p[2]:.3f},'
                f'{speed:.3f},{int(welding)},5,120,15'
            )
        rows = ['TimeReceived,X,Z,Intensity']
        lateral = np.linspace(-12e-3, 15e-3, 180)
        for t in np.arange(kt[1] - 0.2, kt[3], 0.02):
            tcp = [np.interp(t, kt, kp[:, i]) for i in range(3)]
            x, y = tcp[0] + SHIFT[0], tcp[1] + SHIFT[1] + lateral
            z = 0.001 + TILT[0] * x + TILT[1] * y + bead(x, y, height)
            distance = tcp[2] + 0.1 - z + rng.normal(0, 20e-6, 180)
            stamp = datetime(2026, 1, 2, 10) + timedelta(seconds=round(float(t - LAG), 3))
            text = stamp.isoformat(sep=' ', timespec='milliseconds')
            columns = [' '.join(f'{v * 1e3:.3f}' for v in c) for c in (lateral, distance)]
            rows.append(f'{text},{columns[0]},{columns[1]},{" ".join(["9"] * 180)}')
        (folder / f'LaserCoordinate{scan + 1}.csv').write_text('\r\n'.join(rows) + '\r\n')
    (folder / 'arc_log.csv').write_text('\r'.join(lines))


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('recording')
    write_recording(path)
    return path


def read(folder: Path):
    lasers = [read_laser_csv(p) for p in sorted(folder.glob('LaserCoordinate*.csv'))]
    return lasers, read_arc_log(folder / 'arc_log.csv')


def test_clocks_mounting_and_heights_are_found(folder):
    wall = fuse_wall(*read(folder), cell=1e-3)
    assert np.allclose(wall.lags, LAG, atol=0.015)
    assert abs(wall.shift[0] - SHIFT[0]) < 1.5e-3
    assert abs(wall.shift[1] - SHIFT[1]) < 0.2e-3
    assert abs(wall.bead.axis - WALL_Y) < 0.2e-3
    for top, height in zip(wall.tops, LAYERS[1:], strict=True):
        assert abs(top.mean - height) < max(3 * top.mean_u, 5e-6)
        assert top.mean_u < 20e-6
        assert np.abs(top.height[top.inner] - height).max() < 0.05e-3
    assert abs(np.nanmedian(wall.maps[0].z)) < 5e-6, 'z = 0 is the substrate'


def test_times_come_back_from_truncated_stamps():
    rng = np.random.default_rng(2)
    t = 1000.0 + np.cumsum(rng.choice([0.048, 0.052, 0.152], 60, p=[0.45, 0.45, 0.1]))
    x = 0.44 - SPEED * t
    back, slack = restore_times(np.floor(t * 10) / 10, x, -SPEED, 0.1)
    assert 0 <= slack < 0.03
    assert np.abs(back - t).max() <= 0.5 * slack + 1e-9


def test_the_substrate_is_found_beside_walls():
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 0.06, (20_000, 2))
    z = 0.1 + 0.02 * xy[:, 0] - 0.03 * xy[:, 1] + rng.normal(0, 30e-6, len(xy))
    z[xy[:, 1] > 0.045] += 7e-3
    plane = fit_substrate(np.column_stack([xy, z]))
    assert np.allclose([plane.a, plane.b, plane.c], [0.1, 0.02, -0.03], atol=2e-4)
    level = plane.rotation @ np.array([-plane.b, -plane.c, 1.0])
    assert np.allclose(level[:2], 0, atol=1e-5)


@pytest.mark.parametrize('offset', [0.0, 0.4, -0.9])
def test_the_crown_is_where_the_parabola_is_highest(offset):
    rng = np.random.default_rng(3)
    y = np.linspace(-1, 1, 50)
    z = 4e-3 - 1e-3 * (y - offset) ** 2 + rng.normal(0, 20e-6, 50)
    z[[7, 30]] += 2e-3
    top, u = crown(y, z)
    assert abs(top - 4e-3) < 4 * u < 60e-6
    assert np.isnan(crown(y[:5], z[:5])[0])


def test_recordings_that_do_not_fit_are_refused(folder, tmp_path):
    lasers, log = read(folder)
    with pytest.raises(WallError, match='at least two scans'):
        fuse_wall(lasers[:1], log)
    with pytest.raises(WallError, match='no bead appears'):
        fuse_wall([lasers[0], lasers[0]][:1] * 1 + [shifted(lasers[0], 40.0)], log)
    with pytest.raises(WallError, match='no scanning motion'):
        fuse_wall([shifted(lasers[0], 1000.0), lasers[1]], log)
    with pytest.raises(WallError, match='same motion'):
        fuse_wall([lasers[0], lasers[0]], log)
    write_recording(tmp_path, arc_off=True)
    with pytest.raises(WallError, match='arc was never on'):
        fuse_wall(*read(tmp_path))


def shifted(laser, seconds):
    from dataclasses import replace

    return replace(laser, stamps=laser.stamps + round(seconds * 1e9))


CALL = (
    'import argparse, sys; from waam_scan import cli; p = argparse.ArgumentParser(prog="waam"); '
    's = p.add_subparsers(required=True); cli.register(s); a = p.parse_args(); sys.exit(a.run_command(a))'
)


def waam(*args, cwd):
    return subprocess.run(
        [sys.executable, '-c', CALL, *map(str, args)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_the_command_writes_maps_and_prints_the_bead_tops(folder, tmp_path):
    ran = waam('scan', 'fuse', folder, '--out', 'maps', '--ply', cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    names = sorted(p.name for p in (tmp_path / 'maps').iterdir())
    assert names == [f'scan_{k:03d}.{e}' for k in range(3) for e in ('npz', 'ply', 'png')]
    table = [line.split() for line in ran.stdout.splitlines()]
    means = {row[0]: float(row[1]) for row in table if len(row) == 7 and row[0] in ('1', '2')}
    assert abs(means['1'] - 2.2) < 0.05 and abs(means['2'] - 4.1) < 0.05
    grid = load_map(tmp_path / 'maps/scan_002.npz')
    assert abs(np.nanmax(grid.z) - 4.1e-3) < 0.2e-3, 'a cell of 1 mm averages over the crown'
    assert waam('scan', 'picture', 'maps/scan_002.npz', cwd=tmp_path).returncode == 0
    assert 'map of' in waam('scan', 'info', 'maps/scan_002.npz', cwd=tmp_path).stdout


@pytest.mark.parametrize(
    'args, words',
    [
        (['fuse', 'absent'], ['absent', 'no such file or folder']),
        (['fuse', '.'], ['no LaserCoordinateN.csv']),
        (['picture', 'absent.npz'], ['absent.npz', 'no such file']),
        (['info', 'text.csv'], ['text.csv', 'line 1']),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path, args, words):
    (tmp_path / 'text.csv').write_text('a,b\n1,2\n')
    ran = waam('scan', *args, cwd=tmp_path)
    assert ran.returncode != 0
    assert 'Traceback' not in ran.stderr and len(ran.stderr.splitlines()) == 1
    for word in words:
        assert word in ran.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ['text.csv'], 'nothing half-done stays'


def copied(folder, tmp_path):
    for p in folder.glob('*.csv'):
        (tmp_path / p.name).write_bytes(p.read_bytes())
    return tmp_path


def change(file, *changes):
    """(line, what becomes of its text) in a file of the recording; the first line is 1."""
    lines = file.read_text().splitlines()
    for n, what in changes:
        lines[n - 1] = what(lines[n - 1])
    file.write_text('\n'.join(lines))


def one_point(line):
    return ','.join(cell.split()[0] if k else cell for k, cell in enumerate(line.split(',')))


def all_nan(line):
    stamp, x, z, light = line.split(',')
    return ','.join([stamp, x, ' '.join(['nan'] * len(z.split())), light])


BAD = [
    (7, lambda text: text.replace('-12.000', 'twelve', 1), 'field X'),
    (9, one_point, 'only 1 of the usual 180 points'),
    (11, all_nan, 'not one point (NaN)'),
    (13, lambda text: text.rpartition(' ')[0], 'need equal numbers'),
    (15, lambda text: text.rpartition(',')[0], '3 fields'),
    (17, lambda text: '\x00' + text[5:], 'not a date and time'),
]


def test_bad_profiles_are_left_out_by_name_and_the_rest_goes_on(folder, tmp_path):
    copied(folder, tmp_path)
    laser = tmp_path / 'LaserCoordinate2.csv'
    last = len(laser.read_text().splitlines())  # in the ramp that tells the clocks apart
    change(laser, *((n, what) for n, what, _ in BAD), (last, one_point))
    ran = waam('scan', 'fuse', tmp_path, '--out', tmp_path / 'maps', cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    notes = ran.stderr.splitlines()
    for n, _, word in BAD:
        (note,) = [t for t in notes if f'LaserCoordinate2.csv, line {n}:' in t]
        assert word in note
    assert f'line {last}: only 1' in ran.stderr
    assert notes[-1] == 'note: 1 line, 6 profiles left out; the rest is used'
    whole = waam('scan', 'fuse', folder, '--out', tmp_path / 'whole', cwd=tmp_path)
    assert whole.returncode == 0 and not whole.stderr, whole.stderr
    for k in range(3):
        a, b = (load_map(tmp_path / d / f'scan_{k:03}.npz').z for d in ('maps', 'whole'))
        assert np.nanmax(np.abs(a - b)) < 0.3e-3
        assert k == 1 or np.nanmedian(np.abs(a - b)) < 1e-6, 'the other scans are as they were'


def unreadable(file):
    text = file.read_text().splitlines()
    file.write_text('\n'.join([text[0], *(t.replace(t.split(',')[1], 'x') for t in text[1:])]))


def at_another_time(file):
    file.write_text(file.read_text().replace(' 10:02:', ' 10:32:').replace(' 10:03:', ' 10:33:'))


@pytest.mark.parametrize(
    'damage, word',
    [
        (lambda f: f.write_text('dust'), 'header is'),
        (lambda f: f.write_bytes(b'\xff\xfe\x00\xd8'), 'cannot be read'),
        (lambda f: f.unlink(), 'is missing'),
        (unreadable, 'no profile in it'),
        (at_another_time, 'no scanning motion'),
    ],
)
def test_a_bad_scan_is_left_out_by_name(folder, tmp_path, damage, word):
    copied(folder, tmp_path)
    damage(tmp_path / 'LaserCoordinate2.csv')
    ran = waam('scan', 'fuse', tmp_path, '--out', tmp_path / 'maps', cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    (note,) = [t for t in ran.stderr.splitlines() if 'LaserCoordinate2.csv: ' in t and word in t]
    assert '1 scan' in ran.stderr.splitlines()[-1]
    made = sorted(p.name for p in (tmp_path / 'maps').glob('*.npz'))
    assert made == ['scan_000.npz', 'scan_002.npz'], 'scans keep their numbers'
    assert 'over 2 layers' in ran.stdout


def test_a_scan_without_its_lift_takes_the_clock_of_the_others(folder, tmp_path):
    copied(folder, tmp_path)
    laser = tmp_path / 'LaserCoordinate3.csv'
    lines = laser.read_text().splitlines()
    laser.write_text('\n'.join(lines[:-20]))
    ran = waam('scan', 'fuse', tmp_path, '--out', tmp_path / 'maps', cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert 'LaserCoordinate3.csv: the profiles do not show' in ran.stderr
    assert 'clock of the other scans' in ran.stderr
    assert len(list((tmp_path / 'maps').glob('*.npz'))) == 3


def test_damaged_lines_of_the_robot_log_are_left_out(folder, tmp_path):
    copied(folder, tmp_path)
    log = tmp_path / 'arc_log.csv'
    lines = log.read_text().splitlines()
    lines[3], lines[9] = '??' + lines[3], lines[9][:12]
    log.write_text('\r'.join(lines))
    ran = waam('scan', 'fuse', tmp_path, '--out', tmp_path / 'maps', cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert 'arc_log.csv, line 4' in ran.stderr and 'arc_log.csv, line 10' in ran.stderr
    assert '2 lines left out' in ran.stderr


def test_nothing_is_written_when_nothing_is_left(folder, tmp_path):
    copied(folder, tmp_path)
    for k in (1, 2):
        (tmp_path / f'LaserCoordinate{k}.csv').write_text('dust')
    ran = waam('scan', 'fuse', tmp_path, '--out', tmp_path / 'maps', cwd=tmp_path)
    assert ran.returncode == 1 and len(ran.stderr.splitlines()) == 1
    assert 'at least two scans' in ran.stderr and 'LaserCoordinate1.csv' in ran.stderr
    assert not (tmp_path / 'maps').exists()


def test_help_teaches(tmp_path):
    ran = waam('scan', 'fuse', '--help', cwd=tmp_path)
    for word in ('LaserCoordinate1.csv', 'arc_log.csv', 'examples:', 'waam scan fuse', 'mm'):
        assert word in ran.stdout


@needs_data
def test_the_real_wall_makes_sense():
    wall = fuse_wall(*read(DATA))
    assert np.ptp(wall.lags) < 0.06, 'one lag fits all scans'
    assert all(abs(abs(s.motion.speed) - 2.0 / 60) < 0.2e-3 for s in wall.scans), (
        'programmed: 2 m/min'
    )
    means = np.array([t.mean for t in wall.tops])
    planned = np.array([2.0, 3.95, 5.95]) * 1e-3
    assert (np.diff(means) > 1e-3).all()
    assert np.abs(means - planned).max() < 0.8e-3
    length = wall.bead.end - wall.bead.start
    assert 0.045 < length < 0.055, 'the programme welds 50 mm'
    assert all(m.coverage > 0.9 and m.residual < 50e-6 for m in wall.maps)
