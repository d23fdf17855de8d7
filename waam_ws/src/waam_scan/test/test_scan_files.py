"""`waam scan fuse` on passes and clouds of all formats."""

import numpy as np
import pytest
from scan_cli import run

from waam_scan.map_file import load_map

CELL = 0.5e-3


def surface(x, y):
    """m"""
    return 2e-3 + 0.1 * x + 0.3e-3 * np.sin(y / 2e-3)


def cloud(n=20_000):
    """(n, 3) mm"""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 20e-3, n), rng.uniform(0, 10e-3, n)
    return np.column_stack([x, y, surface(x, y) + rng.normal(0, 10e-6, n)]) * 1e3


def write_cloud(path, points, kind):
    """Every format that is read, written as others would."""
    import open3d as o3d

    pc = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if kind == 'npy':
        np.save(path, points.astype(np.float32))
    elif kind == 'xyz':
        np.savetxt(path, points, '%.6f')
    else:
        assert o3d.io.write_point_cloud(str(path), pc, compressed=kind == 'compressed')


@pytest.mark.parametrize(
    'name, kind',
    [
        ('c.pcd', 'compressed'), ('e.ply', 'binary'), ('f.npy', 'npy'), ('g.xyz', 'xyz'),
    ],
)  # fmt: skip
def test_clouds_become_maps(tmp_path, capsys, name, kind):
    write_cloud(tmp_path / name, cloud(), kind)
    assert run('fuse', tmp_path / name, '--cell', 0.5, '--ply', '--out', tmp_path / 'maps') == 0
    assert (tmp_path / 'maps' / name).with_suffix('.ply').read_bytes().startswith(b'ply')
    grid = load_map((tmp_path / 'maps' / name).with_suffix('.npz'))
    x, y = np.meshgrid(grid.spec.x, grid.spec.y)
    assert grid.spec.shape == (20, 40) and np.isfinite(grid.z).all()
    assert np.sqrt(np.mean((grid.z - surface(x, y)) ** 2)) < 10e-6
    assert '100.0% known' in capsys.readouterr().out


def write_pass(path, reverse=False, gap=False, seed=0):
    """4 s along x at 5 mm/s, 100 Hz profiles, 50 Hz poses; the scanner 30 mm ahead, 100 mm up."""
    rng = np.random.default_rng(seed)
    pose_t = np.arange(0, 4.1, 0.02)
    if gap:
        pose_t = pose_t[(pose_t < 1.5) | (pose_t > 2.0)]
    t = np.arange(0.05, 4.0, 0.01)
    start = rng.uniform(0, 0.05e-3)

    def along(at):
        return start + (20e-3 - 5e-3 * at if reverse else 5e-3 * at)

    poses = np.column_stack([along(pose_t) - 30e-3, np.full_like(pose_t, 5e-3), 0 * pose_t])
    x = np.tile(np.linspace(-5e-3, 5e-3, 200), (len(t), 1))
    z = surface(along(t)[:, None], 5e-3 + x) - 0.1 + rng.normal(0, 20e-6, x.shape)
    z[rng.random(z.shape) < 0.05] = np.nan
    np.savez(
        path, stamps=(t * 1e9).astype(np.int64), x=x, z=z,
        pose_stamps=(pose_t * 1e9).astype(np.int64), poses=poses,
    )  # fmt: skip


MOUNT = ('--mount', 30, 0, 100, 0, 0, 90)


def test_passes_of_both_directions_become_one_map(tmp_path, capsys):
    write_pass(tmp_path / 'there.npz')
    write_pass(tmp_path / 'back.npz', reverse=True, gap=True, seed=1)
    files = (tmp_path / 'there.npz', tmp_path / 'back.npz')
    assert run('fuse', *files, '--cell', 0.5, '--out', tmp_path, *MOUNT) == 0
    text = capsys.readouterr().out
    assert '395 profiles used, 0 rejected' in text
    assert 'rejected: ' in text and 'in a gap of the telemetry' in text
    grid = load_map(tmp_path / 'there.npz')
    x, y = np.meshgrid(grid.spec.x, grid.spec.y)
    known = np.isfinite(grid.z)
    assert known.mean() > 0.7
    assert np.sqrt(np.mean((grid.z - surface(x, y))[known] ** 2)) < 10e-6


def damaged_pass(path, **changes):
    """A pass with other arrays."""
    write_pass(path)
    arrays = dict(np.load(path))
    np.savez(path, **{k: changes[k](v) if k in changes else v for k, v in arrays.items()})


def only(n, keep):
    """Profile n keeps `keep` points."""

    def change(values):
        values = values.copy()
        values[n, keep:] = np.nan
        return values

    return change


@pytest.mark.parametrize(
    'changes, word',
    [
        ({'z': lambda z: z * np.nan}, 'not a single return'),
        ({'z': lambda z: z[:, :0], 'x': lambda x: x[:, :0]}, 'not a single return'),
        ({'z': lambda z: z[:-1]}, 'do not fit together'),
        ({'poses': lambda p: p[:1], 'pose_stamps': lambda t: t[:1]}, 'do not fit together'),
        ({'poses': lambda p: p * np.nan}, 'poses must be finite'),
        ({'stamps': lambda t: t + 10**13}, 'not one profile could be used'),
        ({'stamps': lambda t: t.astype(float)}, 'stamps must be a row of integers'),
    ],
)
def test_a_bad_pass_is_left_out_by_name_and_the_others_stay(tmp_path, capsys, changes, word):
    files = [tmp_path / f'p{k}.npz' for k in range(2)]
    for k, file in enumerate(files):
        write_pass(file, seed=k)
    bad = tmp_path / 'bad.npz'
    damaged_pass(bad, **changes)
    paths = [files[0], bad, files[1]]
    assert run('fuse', *paths, '--cell', 0.5, '--out', tmp_path / 'm', *MOUNT) == 0
    said = capsys.readouterr()
    assert said.out.count('395 profiles used') == 2
    notes = said.err.splitlines()
    assert f'left out: {bad}: ' in notes[0] and word in notes[0], notes
    assert notes[-1] == 'note: 1 scan left out; the rest is used'


def test_profiles_of_one_point_are_left_out_by_number(tmp_path, capsys):
    write_pass(tmp_path / 'a.npz')
    damaged_pass(tmp_path / 'b.npz', z=only(17, 1))
    paths = (tmp_path / 'a.npz', tmp_path / 'b.npz')
    assert run('fuse', *paths, '--cell', 0.5, '--out', tmp_path, *MOUNT) == 0
    said = capsys.readouterr()
    assert '394 profiles used' in said.out
    assert f'{tmp_path / "b.npz"}, profile 17: only one point' in said.err
    damaged_pass(tmp_path / 'c.npz', z=lambda z: np.where(np.arange(z.shape[1]) < 1, z, np.nan))
    assert run('fuse', tmp_path / 'c.npz', '--out', tmp_path / 'none', *MOUNT) == 1
    said = capsys.readouterr()
    assert 'c.npz' in said.err and 'more than one point' in said.err
    assert not (tmp_path / 'none').exists()


def test_a_bad_cloud_among_others_is_left_out(tmp_path, capsys):
    (tmp_path / 'broken.pcd').write_bytes(b'# .PCD v0.7\nFIELDS x y z\nDATA binary\n\x00')
    write_cloud(tmp_path / 'good.npy', cloud(), 'npy')
    paths = (tmp_path / 'broken.pcd', tmp_path / 'good.npy')
    assert run('fuse', *paths, '--cell', 0.5, '--out', tmp_path / 'm') == 0
    assert 'broken.pcd' in capsys.readouterr().err
    assert (tmp_path / 'm/good.npz').exists() and not (tmp_path / 'm/broken.npz').exists()


def test_bad_input_is_one_line_that_names_it(tmp_path, capsys):
    (tmp_path / 'notes.txt').write_text('hello')
    (tmp_path / 'broken.pcd').write_bytes(b'# .PCD v0.7\nFIELDS x y z\nDATA binary\n\x00')
    write_cloud(tmp_path / 'wide.npy', cloud() * 1000, 'npy')
    for file, word in (
        ('notes.txt', 'neither a recording'),
        ('broken.pcd', 'broken.pcd'),
        ('none.ply', 'no such file'),
        ('wide.npy', '--scale'),
    ):
        assert run('fuse', tmp_path / file, '--out', tmp_path / 'o') == 1
        err = capsys.readouterr().err
        assert word in err and len(err.splitlines()) == 1, err
    assert run('fuse', tmp_path / 'x.npz', '--calibration', tmp_path / 'c.yaml', *MOUNT) == 1
    assert 'contradict' in capsys.readouterr().err


def test_a_folder_of_other_logs_is_sent_to_import(tmp_path, capsys):
    (tmp_path / 'LaserCoordinate1.csv').write_text('X,Z\n1,2\n')
    assert run('fuse', tmp_path) == 1
    error = capsys.readouterr().err
    assert str(tmp_path) in error and 'waam record import' in error and 'Traceback' not in error


def test_calibration_goes_on_without_a_bad_pass(tmp_path, capsys):
    from waam_scan.commands.calibration_report import read_passes

    write_pass(tmp_path / 'a.npz')
    (tmp_path / 'b.npz').write_bytes(b'dust')
    (found,) = read_passes([tmp_path / 'a.npz', tmp_path / 'b.npz'])
    assert found.name == 'a'
    err = capsys.readouterr().err
    assert f'left out: {tmp_path / "b.npz"}: not a recorded pass' in err
    with pytest.raises(ValueError, match='b.npz'):
        read_passes([tmp_path / 'b.npz'])
