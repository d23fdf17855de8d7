"""Readers, on small synthetic files and on the recordings beside the checkout."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from waam_process.grid import GridSpec
from waam_scan.commands.file_info import describe
from waam_scan.recordings.files import (
    FileError,
    load_map,
    read_arc_log,
    read_inprocess_csv,
    read_laser_csv,
    save_map,
)
from waam_scan.recordings.left_out import LeftOut, NothingLeft

DATA = Path(__file__).resolve().parents[5] / 'shared/data'
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f'no recordings at {DATA}')

LASER = (
    'TimeReceived,X,Z,Intensity\r\n2025-04-15 17:36:53.860,1.5 -2 3,140 141.5 142,9 8 7\r\n\r\n'
    '2025-04-15 17:36:53.890,1 2,140 141,5 5\r\n'
)
ARC = (
    'time, x, y, z, speed, ArcOn, WFS, I, U, tool, frame\r'
    '59:59.9,450,799.5,35.4,0.6,0,6,120,15,4,7\r'
    '00:00.0,449,799.5,35.4,0.6,1,6,120,15,4,7\r'
    '00:00.1,448,799.5,35.4,0.6,1,6,120,15,4,7'
)
INPROCESS = (
    'Layer,ScanID,Timestamp,SensorTimestamp,PointNr,X,Z\n'
    '25,1,10.5,30.03.2026 16:34,0,4.4,157.9\n25,1,10.5,30.03.2026 16:34,1,4.3,157.8\n25,2,10.6,x,0,5.0,156.0\n'
)


def write(tmp_path: Path, text: str, name: str = 'f.csv') -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode())
    return path


def test_laser_profiles_of_different_length_and_blank_lines(tmp_path):
    scan = read_laser_csv(write(tmp_path, LASER))
    assert np.allclose(scan.x[0], [1.5e-3, -2e-3, 3e-3])
    assert np.allclose(scan.range[1, :2], [0.140, 0.141]) and np.isnan(scan.range[1, 2])
    assert np.diff(scan.stamps)[0] == 30_000_000
    assert 'longest gap 0.030 s' in describe(tmp_path / 'f.csv')


def test_the_arc_log_has_bare_carriage_returns_and_passes_the_hour(tmp_path):
    log = read_arc_log(write(tmp_path, ARC))
    assert np.allclose(log.t, [3599.9, 3600.0, 3600.1])
    assert np.allclose(log.position[0], [0.45, 0.7995, 0.0354])
    assert log.arc.tolist() == [False, True, True]
    assert np.allclose([log.speed[0], log.wire_feed[0]], [0.01, 0.1])
    assert '1 arc starts' in describe(tmp_path / 'f.csv')


def test_points_are_grouped_into_profiles(tmp_path):
    scan = read_inprocess_csv(write(tmp_path, INPROCESS))
    assert scan.x.shape == (2, 2) and np.isnan(scan.x[1, 1])
    assert np.allclose(scan.t, [10.5, 10.6])
    assert '2 profiles' in describe(tmp_path / 'f.csv')


@pytest.mark.parametrize(
    'reader, good, old, new, words',
    [
        (read_laser_csv, LASER, '141.5', 'x41', ['line 2', 'field Z']),
        (read_laser_csv, LASER, '141.5', 'inf', ['line 2', 'infinite']),
        (read_laser_csv, LASER, ',5 5', ',5', ['line 4', 'equal numbers']),
        (read_laser_csv, LASER, ',5 5', '', ['line 4', '3 fields']),
        (
            read_laser_csv,
            LASER,
            '2025-04-15 17:36:53.890',
            'noon',
            ['line 4', 'TimeReceived', 'noon'],
        ),
        (read_laser_csv, LASER, 'TimeReceived,', 'Time,', ['line 1', 'header']),
        (read_arc_log, ARC, ' WFS,', ' wire,', ['line 1', 'WFS']),
        (read_arc_log, ARC, '00:00.0', '00:61.0', ['line 3', 'time']),
        (read_arc_log, ARC, '449', 'nan', ['line 3', 'not a number']),
        (read_arc_log, ARC, '449', '4e', ['line 3', 'field x']),
        (read_arc_log, ARC, ',448', '', ['line 4', '10 fields']),
        (read_inprocess_csv, INPROCESS, '4.3,', 'four,', ['line 3', 'four']),
        (read_inprocess_csv, INPROCESS, '4.3,', ',', ['line 3', 'must be numbers']),
    ],
)
def test_damage_is_named_with_file_and_line(tmp_path, reader, good, old, new, words):
    assert old in good
    path = write(tmp_path, good.replace(old, new, 1))
    with pytest.raises(FileError) as error:
        reader(path)
    for word in [str(path), *words]:
        assert word in str(error.value)


@pytest.mark.parametrize('reader', [read_laser_csv, read_arc_log, read_inprocess_csv, load_map])
def test_missing_empty_and_binary_files(tmp_path, reader):
    cases = [tmp_path / 'absent', tmp_path, write(tmp_path, '')]
    binary = tmp_path / 'binary'
    binary.write_bytes(bytes(range(256)) * 20)
    for path in [*cases, binary]:
        with pytest.raises(FileError, match=str(path)):
            reader(path)


def test_only_a_header_is_no_data(tmp_path):
    for reader, good in (
        (read_laser_csv, LASER),
        (read_arc_log, ARC),
        (read_inprocess_csv, INPROCESS),
    ):
        head = good.replace('\r', '\n').split('\n')[0]
        with pytest.raises(FileError, match='no '):
            reader(write(tmp_path, head + '\n'))


def test_a_map_survives_the_file(tmp_path):
    spec = GridSpec(0.1, -0.2, 0.5e-3, 3, 4)
    z = np.arange(12.0).reshape(3, 4) * 1e-3
    z[1, 1] = np.nan
    save_map(
        tmp_path / 'm.npz', spec, z, z * 0 + 1e-5, np.ones((3, 4), np.uint16), layer=np.array(2)
    )
    back = load_map(tmp_path / 'm.npz')
    assert back.spec == spec
    assert np.allclose(back.z, z, equal_nan=True)
    np.savez(tmp_path / 'other.npz', a=np.zeros(3))
    with pytest.raises(FileError, match='not a height map'):
        load_map(tmp_path / 'other.npz')


@needs_data
def test_the_recorded_wall_is_read_whole():
    counts = [99, 88, 97, 97]
    for number, count in enumerate(counts, 1):
        scan = read_laser_csv(DATA / f'wall_profiles/LaserCoordinate{number}.csv')
        assert scan.x.shape == (count, 1024)
        assert (np.diff(scan.stamps) > 0).all()
    log = read_arc_log(DATA / 'wall_profiles/arc_log.csv')
    assert len(log.t) == 3230
    assert int((np.diff(log.arc.astype(int), prepend=0) == 1).sum()) == 6


@needs_data
def test_the_recorded_profiles_beside_the_arc_are_read():
    scan = read_inprocess_csv(DATA / 'inprocess_profiles/Representative_Layer_raw_points.csv')
    points = np.isfinite(scan.x).sum(axis=1)
    assert (len(points), points.min(), points.max()) == (399, 1, 56)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.sampled_from(
        [(read_laser_csv, LASER), (read_arc_log, ARC), (read_inprocess_csv, INPROCESS)]
    ),
    st.lists(
        st.tuples(st.integers(0, 300), st.text('0123456789.,:- \r\nnaife\x00é', max_size=3)),
        max_size=5,
    ),
)
def test_damaged_files_are_read_with_names_of_what_is_left_out_or_refused(tmp_path, kind, changes):
    reader, text = kind
    for at, put in changes:
        text = text[:at] + put + text[at + 1 :]
    path, left_out = write(tmp_path, text), LeftOut()
    try:
        reader(path, left_out)
    except FileError as e:
        assert str(path) in str(e)
    for line in left_out.lines()[:-1]:
        assert str(path) in line and 'line ' in line


def test_many_bad_lines_are_counted_not_listed(tmp_path):
    text = LASER + ''.join('noon,1 2,3 4,5 6\r\n' for _ in range(500))
    left_out = LeftOut()
    scan = read_laser_csv(write(tmp_path, text), left_out)
    lines = left_out.lines()
    assert len(scan.stamps) == 2 and len(lines) == 14
    assert '488 more of its profiles, the last one line 504' in lines[-2]
    assert lines[-1] == '500 profiles left out; the rest is used'
    assert isinstance(left_out.nothing_left('x'), NothingLeft)


def test_info_and_filter_name_a_bad_file_and_go_on(tmp_path, capsys):
    import argparse

    from waam_scan import cli

    good, bad = (
        write(tmp_path, INPROCESS + '25,3,x,y\n', 'good.csv'),
        write(tmp_path, 'dust', 'bad.csv'),
    )
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())

    def run(*words):
        args = parser.parse_args(['scan', *map(str, words)])
        return args.run_command(args)

    assert run('info', bad, good) == 0
    said = capsys.readouterr()
    assert '2 profiles' in said.out and f'left out: {bad}' in said.err
    assert (
        f'left out: {good}, line 5: 4 fields' in said.err and '1 file, 1 line left out' in said.err
    )
    assert run('info', bad) == 1
    assert capsys.readouterr().err.count('\n') == 1
