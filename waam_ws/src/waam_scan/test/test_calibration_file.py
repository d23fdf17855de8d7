"""The command, the file that it writes, and that nobody can change it unnoticed."""

from datetime import UTC, datetime

import calibration_sim as sim
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scan_cli import run

from waam_scan.calibration.file import CalibrationFileError, load_calibration, rpy_of
from waam_scan.calibration.pass_file import load_pass, save_pass
from waam_scan.calibration.scan_pass import Pass, ScanError, gather
from waam_scan.transform import rotation_rpy

ARTEFACT = """\
kind: block
name: step block 7
top_mm: [20, 14]
height_mm: 12
slope_deg: [45, 40]
position_mm: [100, 60, 0]
position_sigma_mm: 0.005
"""
OFFSET, RPY, DELAY = np.array([0.062, -0.003, 0.118]), np.radians([1.0, -0.5, 91.5]), 0.012


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """block.yaml and five passes."""
    path = tmp_path_factory.mktemp('calibration')
    (path / 'block.yaml').write_text(ARTEFACT)
    slopes = (np.radians(45), np.radians(40))
    world = sim.block_world((0.020, 0.014), 0.012, slopes, (0.1, 0.06, 0.0), 0.0)
    rng = np.random.default_rng(0)
    for p in sim.passes_over(world, (0.1, 0.06), OFFSET, RPY, DELAY, rng, points=80):
        save_pass(path / f'{p.name}.npz', p)
    return path


@pytest.fixture(scope='module')
def written(folder):
    out = folder / 'calibration.yaml'
    passes = sorted(folder.glob('pass_*.npz'))
    assert run('calibrate', folder / 'block.yaml', *passes, '--out', out) == 0
    return out


def test_the_command_writes_what_the_node_can_use(written):
    c = load_calibration(written)
    assert np.abs(c.mounting.offset - OFFSET).max() < 20e-6
    assert np.abs(c.mounting.rotation - rotation_rpy(*RPY)).max() < np.radians(0.02)
    assert abs(c.mounting.delay - DELAY) < 0.5e-3
    assert c.artefact == 'step block 7' and len(c.hash) == 64
    assert datetime.fromisoformat(c.date).tzinfo == UTC
    assert (c.sigma[:3] > 4.9e-6).all() and (c.sigma[:3] < 20e-6).all()  # the touch-off is in it
    assert written.with_suffix('.png').stat().st_size > 10_000


def test_a_file_changed_by_hand_is_refused(written, tmp_path):
    text = written.read_text()
    data = yaml.safe_load(text)
    data['mount_xyz'][2] += 1e-4
    changed = tmp_path / 'changed.yaml'
    changed.write_text(yaml.safe_dump(data))
    with pytest.raises(CalibrationFileError, match='changed by hand'):
        load_calibration(changed)
    changed.write_text(yaml.safe_dump(yaml.safe_load(text), sort_keys=True))  # only the layout
    assert load_calibration(changed).hash == load_calibration(written).hash


@pytest.mark.parametrize(
    'text, word',
    [
        ('', 'version'),
        ('waam_calibration: 2', 'version'),
        ('[1, 2', 'damaged'),
        ('waam_calibration: 1', 'hand'),
    ],
)
def test_other_files_are_refused(tmp_path, text, word):
    path = tmp_path / 'c.yaml'
    path.write_text(text)
    with pytest.raises(CalibrationFileError, match=word):
        load_calibration(path)
    with pytest.raises(CalibrationFileError, match='no such file'):
        load_calibration(tmp_path / 'none.yaml')


def test_one_way_is_refused_and_named_and_writes_no_file(folder, tmp_path, capsys):
    out = tmp_path / 'c.yaml'
    words = ('calibrate', folder / 'block.yaml', folder / 'pass_0.npz', '--out', out)
    assert run(*words) == 1
    error = capsys.readouterr().err
    assert 'position along the travel axis (x) together with time offset' in error
    assert not out.exists()
    assert run(*words, '--accept-unobserved') == 0
    assert yaml.safe_load(out.read_text())['unobserved']


@pytest.mark.parametrize(
    'words, text',
    [
        (('none.yaml', 'pass_0.npz'), 'none.yaml: no such file'),
        (('block.yaml', 'none.npz'), 'none.npz: no such file'),
        (('block.yaml', 'block.yaml'), 'not a recorded pass'),
    ],
)
def test_bad_input_is_one_clear_line(folder, capsys, words, text):
    assert run('calibrate', *(folder / w for w in words), '--out', folder / 'x.yaml') == 1
    error = capsys.readouterr().err
    assert error.startswith('error: ') and text in error and error.count('\n') == 1


ANGLE = st.floats(-1.5, 1.5)


@given(st.floats(-3.1, 3.1), ANGLE, st.floats(-3.1, 3.1))
def test_angles_of_a_rotation_give_it_back(roll, pitch, yaw):
    assert np.allclose(
        rotation_rpy(*rpy_of(rotation_rpy(roll, pitch, yaw))), rotation_rpy(roll, pitch, yaw)
    )


@pytest.mark.parametrize('sign', [-1, 1])
def test_a_scanner_that_looks_along_x_still_has_angles(sign):
    r = rotation_rpy(0.4, sign * np.pi / 2, 0.9)
    assert np.allclose(rotation_rpy(*rpy_of(r)), r, atol=1e-6)


def make_pass(**changes):
    t = np.arange(20) * 10_000_000
    fields = dict(
        stamps=t + 5_000_000,
        x=np.zeros((20, 4)),
        z=np.zeros((20, 4)),
        pose_stamps=t,
        poses=np.zeros((20, 3)),
    )
    return Pass(**(fields | changes))


@pytest.mark.parametrize(
    'changes, word',
    [
        ({'x': np.zeros((19, 4))}, 'fit'),
        ({'poses': np.zeros((20, 2))}, 'fit'),
        ({'poses': np.full((20, 3), np.nan)}, 'finite'),
        ({'pose_stamps': np.zeros(20, np.int64)}, 'rise'),
    ],
)
def test_passes_that_make_no_sense_are_refused(changes, word):
    with pytest.raises(ScanError, match=word):
        make_pass(**changes)


def test_profiles_without_poses_on_both_sides_are_left_out_and_counted():
    t = np.delete(np.arange(100) * 10_000_000, np.arange(40, 80))  # a gap of 0.41 s
    stamps = np.array([-5, 5, 300, 600, 900, 995]) * 1_000_000
    p = make_pass(
        stamps=stamps,
        x=np.zeros((6, 4)),
        z=np.zeros((6, 4)),
        pose_stamps=t,
        poses=np.zeros((60, 3)),
    )
    points = gather([p], 1000, slack=0.0)
    assert points.rejected == 3  # before the first, in the gap, after the last
    assert sorted(set(points.profile)) == [1, 2, 4]
    assert gather([p], 1000, slack=0.1).rejected == 5


@given(st.binary(max_size=200))
def test_any_bytes_are_refused_as_a_pass(tmp_path_factory, data):
    path = tmp_path_factory.mktemp('bytes') / 'p.npz'
    path.write_bytes(data)
    with pytest.raises(ScanError):
        load_pass(path)
