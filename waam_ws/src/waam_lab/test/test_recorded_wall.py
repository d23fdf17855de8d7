"""A made-up recording with known clocks, mounting and heights must come out right; the real one must make sense."""

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from waam_lab.recorded.wall import (
    clock_lag,
    fit_substrate,
    fuse_wall,
    match_scans,
    profile_points,
    read_laser,
    read_log,
    read_wall,
    restore_times,
)
from waam_lab.twin.records import RecordError

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
    files = sorted(folder.glob('LaserCoordinate*.csv'))
    return {p.name: read_laser(p, []) for p in files}, read_log(folder / 'arc_log.csv', [])


def heights(wall, k):
    """(n,) m along the crown of map k, without its ends."""
    spec, bead = wall.maps[k].spec, wall.bead
    row = int(np.argmin(np.abs(spec.y - bead.axis)))
    inner = (spec.x > bead.start + 8e-3) & (spec.x < bead.end - 8e-3)
    return wall.maps[k].z[row, inner]


def test_clocks_mounting_and_heights_are_found(folder):
    lasers, log = read(folder)
    lags = [clock_lag(lasers[n], log, m) for n, (m, _) in match_scans(lasers, log, []).items()]
    assert np.allclose(lags, LAG, atol=0.015)
    wall = fuse_wall(lasers, log, 0.5e-3, [])
    assert abs(wall.shift[0] - SHIFT[0]) < 1.5e-3
    assert abs(wall.shift[1] - SHIFT[1]) < 0.2e-3
    assert abs(wall.bead.axis - WALL_Y) < 0.2e-3
    for k, height in enumerate(LAYERS):
        assert abs(np.nanmean(heights(wall, k)) - height) < 0.06e-3
    assert abs(np.nanmedian(wall.maps[0].z)) < 5e-6, 'z = 0 is the substrate'
    top = np.nanmax(profile_points(wall.scans[2], wall.shift)[..., 2])
    assert abs(top - LAYERS[2]) < 0.15e-3


def test_times_come_back_from_truncated_stamps():
    rng = np.random.default_rng(2)
    t = 1000.0 + np.cumsum(rng.choice([0.048, 0.052, 0.152], 60, p=[0.45, 0.45, 0.1]))
    x = 0.44 - SPEED * t
    back = restore_times(np.floor(t * 10) / 10, x, -SPEED)
    assert np.abs(back - t).max() <= 0.015


def test_the_substrate_is_found_beside_walls():
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 0.06, (20_000, 2))
    z = 0.1 + 0.02 * xy[:, 0] - 0.03 * xy[:, 1] + rng.normal(0, 30e-6, len(xy))
    z[xy[:, 1] > 0.045] += 7e-3
    assert np.allclose(fit_substrate(np.column_stack([xy, z])), [0.1, 0.02, -0.03], atol=2e-4)


def test_recordings_that_do_not_fit_are_refused(folder, tmp_path):
    lasers, log = read(folder)
    a, b, _ = lasers.values()
    with pytest.raises(RecordError, match='at least two scans'):
        fuse_wall({'a': a}, log, 1e-3, [])
    with pytest.raises(RecordError, match='no bead appears'):
        fuse_wall({'a': a, 'b': replace(a, t=a.t + 40.0)}, log, 1e-3, [])
    left_out = []
    assert list(match_scans({'a': replace(a, t=a.t + 1000.0), 'b': b}, log, left_out)) == ['b']
    assert 'a: no scanning motion' in left_out[0]
    assert list(match_scans({'a': a, 'again': a}, log, left_out)) == ['a']
    assert 'again: another laser file belongs to the same motion' in left_out[1]
    write_recording(tmp_path, arc_off=True)
    with pytest.raises(RecordError, match='arc was never on'):
        read_wall(tmp_path, 1e-3)


def change(file, *changes):
    """(line, what becomes of its text) in a file of the recording; the first line is 1."""
    lines = file.read_text().splitlines()
    for n, what in changes:
        lines[n - 1] = what(lines[n - 1])
    file.write_text('\n'.join(lines))


def one_point(line):
    return ','.join(cell.split()[0] if k else cell for k, cell in enumerate(line.split(',')))


BAD = [
    (7, lambda text: text.replace('-12.000', 'twelve', 1), 'twelve'),
    (9, one_point, 'only 1 points'),
    (13, lambda text: text.replace(' ', 'T', 1).replace(' ', ',', 1), 'cells'),
    (15, lambda text: text.rpartition(',')[0], '3 cells'),
    (17, lambda text: 'noon' + text[5:], 'not a date and time'),
]


def test_bad_profiles_and_lines_are_left_out_by_name_and_the_rest_goes_on(folder, tmp_path):
    for p in folder.glob('*.csv'):
        (tmp_path / p.name).write_bytes(p.read_bytes())
    change(tmp_path / 'LaserCoordinate2.csv', *((n, what) for n, what, _ in BAD))
    change(tmp_path / 'arc_log.csv', (4, lambda text: '??' + text), (10, lambda text: text[:12]))
    wall, _ = read_wall(tmp_path, 1e-3)
    for n, _, word in BAD:
        (note,) = [t for t in wall.left_out if f'LaserCoordinate2.csv, line {n}:' in t]
        assert word in note
    for n in (4, 10):
        assert any(f'arc_log.csv, line {n}:' in t for t in wall.left_out)
    whole, _ = read_wall(folder, 1e-3)
    assert not whole.left_out
    for a, b in zip(wall.maps, whole.maps, strict=True):
        assert np.nanmax(np.abs(a.z - b.z)) < 0.3e-3


@pytest.mark.parametrize('text', ['dust', '', 'TimeReceived,X,Z,Intensity\n'])
def test_a_bad_scan_is_left_out_by_name(folder, tmp_path, text):
    for p in folder.glob('*.csv'):
        (tmp_path / p.name).write_bytes(p.read_bytes())
    (tmp_path / 'LaserCoordinate2.csv').write_text(text)
    wall, _ = read_wall(tmp_path, 1e-3)
    assert len(wall.maps) == 2 and 'LaserCoordinate2.csv' in wall.left_out[0]
    (tmp_path / 'LaserCoordinate1.csv').write_text(text)
    with pytest.raises(RecordError, match='at least two scans.*LaserCoordinate1.csv'):
        read_wall(tmp_path, 1e-3)


def test_a_scan_without_its_lift_takes_the_clock_of_the_others(folder, tmp_path):
    lasers, log = read(folder)
    name = 'LaserCoordinate3.csv'
    cut = slice(0, -20)
    one = lasers[name]
    lasers[name] = replace(one, t=one.t[cut], x=one.x[cut], range=one.range[cut])
    assert np.isnan(match_scans(lasers, log, [])[name][1])
    assert len(fuse_wall(lasers, log, 1e-3, []).maps) == 3


@needs_data
def test_the_real_wall_makes_sense():
    wall, _ = read_wall(DATA, 1e-3)
    assert not wall.left_out
    assert all(abs(abs(s.motion.speed) - 2.0 / 60) < 0.2e-3 for s in wall.scans), (
        'programmed: 2 m/min'
    )
    means = np.array([np.nanmean(heights(wall, k)) for k in (1, 2, 3)])
    planned = np.array([2.0, 3.95, 5.95]) * 1e-3
    assert (np.diff(means) > 1e-3).all()
    assert np.abs(means - planned).max() < 0.8e-3
    assert 0.045 < wall.bead.end - wall.bead.start < 0.055, 'the programme welds 50 mm'
    assert all(m.coverage > 0.9 and m.residual < 50e-6 for m in wall.maps)
