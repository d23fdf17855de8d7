"""Missing metal between nominal and scan: the figures, the files, and that the planner can read them."""

import json

import numpy as np
import pytest
from scan_cli import run

from waam_node.stl import write_stl
from waam_process.grid import GridSpec, HeightGrid
from waam_scan.commands.compare_report import planner_frame
from waam_scan.map_file import load_map
from waam_scan.registration.clouds import is_mesh, load_points, load_triangles
from waam_scan.registration.compare import found_grid, missing_metal, nominal_grid, top_heights

SIZE = np.array([0.060, 0.040, 0.012])
CORNER = np.array([0.10, -0.02, 0.003])  # where the nominal file has the part
POCKET = (0.125, 0.145, -0.012, 0.008, 1.5e-3)  # x, y range and depth of the worn place, m
RIB = 4e-3  # height of a rib that makes yaw and x, y visible


def top(x, y):
    """The nominal top: a plate with two ribs, one along y and one along x, with slopes of 45 deg."""
    along_y = 2e-3 + RIB - np.abs(x - CORNER[0] - 0.010)
    along_x = 1e-3 + RIB - np.abs(y - CORNER[1] - 0.033)
    return CORNER[2] + SIZE[2] - RIB + np.clip(np.maximum(along_y, along_x), 0, RIB)


def box_triangles(low, high):
    """(12, 3, 3) m, outward."""
    x, y, z = np.array([low, high]).T
    v = np.array([[x[i & 1], y[(i >> 1) & 1], z[(i >> 2) & 1]] for i in range(8)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return np.array([v[[a, b, c]] for q in quads for a, b, c in (q[:3], (q[0], q[2], q[3]))])


def rib_triangles(low, high, half, axis):
    """A trapezoid prism on the plate from low to high along the other axis; half: of its crest, around the middle."""
    import trimesh

    middle = 0.5 * (low[axis] + high[axis])
    corners = []
    for other in (low[1 - axis], high[1 - axis]):
        for side, z in ((half + RIB, low[2]), (half, low[2] + RIB)):
            for sign in (-1, 1):
                p = np.empty(3)
                p[axis], p[1 - axis], p[2] = middle + sign * side, other, z
                corners.append(p)
    return np.asarray(trimesh.convex.convex_hull(np.array(corners)).triangles)


def nominal():
    """Plate and ribs as three bodies that touch or overlap."""
    low, high = CORNER, CORNER + SIZE
    floor = high[2] - RIB
    plate = box_triangles(low, [high[0], high[1], floor])
    one = rib_triangles([low[0] + 8e-3, low[1], floor], [low[0] + 12e-3, high[1], 0], 2e-3, 0)
    two = rib_triangles([low[0], low[1] + 32e-3, floor], [high[0], low[1] + 34e-3, 0], 1e-3, 1)
    return np.concatenate([plate, one, two])


def worn_cloud(rng, step=0.2e-3, noise=20e-6):
    """(n, 3) m from above, with a pocket."""
    x, y = np.meshgrid(
        np.arange(CORNER[0] + step / 2, CORNER[0] + SIZE[0], step),
        np.arange(CORNER[1] + step / 2, CORNER[1] + SIZE[1], step),
    )
    x, y = x.ravel() + rng.uniform(-0.05e-3, 0.05e-3, x.size), y.ravel()
    x0, x1, y0, y1, deep = POCKET
    pocket = (x > x0) & (x < x1) & (y > y0) & (y < y1)
    z = top(x, y) - deep * pocket + noise * rng.standard_normal(len(x))
    return np.column_stack([x, y, z])


def test_top_heights_are_those_of_the_mesh():
    grid = nominal_grid(nominal(), 0.5e-3)
    x, y = np.meshgrid(grid.spec.x, grid.spec.y)
    inside = np.isfinite(grid.z)
    assert np.allclose(grid.z[inside], top(x, y)[inside], atol=1e-6)
    area = inside.sum() * grid.spec.resolution**2
    assert np.isclose(area, SIZE[0] * SIZE[1], rtol=1e-3)
    assert np.isnan(top_heights(nominal(), GridSpec(0.0, 0.0, 1e-3, 2, 2))).all()


def test_volume_depth_and_box_of_a_pocket():
    points = worn_cloud(np.random.default_rng(0))
    grid = nominal_grid(nominal(), 0.5e-3)
    m = missing_metal(grid, found_grid(points, grid.spec))
    x0, x1, y0, y1, deep = POCKET
    volume = (x1 - x0) * (y1 - y0) * deep
    assert abs(m.volume - volume) < 0.02 * volume
    assert abs(m.deepest - deep) < 30e-6
    assert np.allclose(m.regions[0].box, (x0, x1, y0, y1), atol=2e-3)
    assert abs(m.box[4] - (CORNER[2] + SIZE[2] - RIB - deep)) < 0.1e-3
    assert len(m.regions) == 1 and np.isclose(m.regions[0].volume, m.volume, rtol=0.02)
    assert m.unseen < 0.02 and m.excess < 0.01 * volume
    assert m.volume_sigma < 0.005 * volume


def test_allowance_adds_its_layer_everywhere_and_a_shared_error_of_level_counts_in_full():
    points = worn_cloud(np.random.default_rng(1))
    grid = nominal_grid(nominal(), 0.5e-3)
    found = found_grid(points, grid.spec)
    plain, more = missing_metal(grid, found), missing_metal(grid, found, 1e-3, level_sigma=20e-6)
    assert abs(more.volume - plain.volume - 1e-3 * SIZE[0] * SIZE[1]) < 0.02 * more.volume
    assert np.isclose(more.volume_sigma, 20e-6 * SIZE[0] * SIZE[1], rtol=0.05)


def test_what_was_not_seen_is_neither_filled_nor_counted():
    points = worn_cloud(np.random.default_rng(2))
    grid = nominal_grid(nominal(), 0.5e-3)
    hidden = (points[:, 0] > 0.135) & (points[:, 0] < 0.150)
    m = missing_metal(grid, found_grid(points[~hidden], grid.spec))
    assert abs(m.unseen - 0.25) < 0.02
    assert np.isnan(m.depth[:, (m.spec.x > 0.136) & (m.spec.x < 0.149)]).all()
    x0, _, y0, y1, deep = POCKET
    assert abs(m.volume - (0.135 - x0) * (y1 - y0) * deep) < 0.05 * m.volume


def test_grids_that_differ_or_never_meet_are_refused():
    grid = nominal_grid(nominal(), 1e-3)
    other = HeightGrid.full(GridSpec(0, 0, 1e-3, 3, 3))
    with pytest.raises(ValueError, match='the scan on'):
        missing_metal(grid, other)
    with pytest.raises(ValueError, match='overlap'):
        missing_metal(grid, HeightGrid.full(grid.spec))


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """nominal.stl and worn.npy; the worn part lies turned by 0.6 deg and shifted by more than a millimetre."""
    folder = tmp_path_factory.mktemp('compare')
    write_stl(folder / 'nominal.stl', nominal() * 1e3, 'part')
    points = worn_cloud(np.random.default_rng(3))
    c, s = np.cos(np.radians(0.6)), np.sin(np.radians(0.6))
    middle = CORNER + SIZE / 2
    placed = (points - middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + middle
    np.save(folder / 'worn.npy', (placed + [1.2e-3, -0.8e-3, 0.5e-3]) * 1e3)
    return folder


def test_compare_registers_writes_and_the_planner_plans_it(files, capsys):
    out = files / 'out'
    assert (
        run('compare', files / 'nominal.stl', files / 'worn.npy', '--register', '--out', out) == 0
    )
    assert 'missing' in capsys.readouterr().out
    data = json.loads((out / 'missing.json').read_text())
    volume = 1e9 * (POCKET[1] - POCKET[0]) * (POCKET[3] - POCKET[2]) * POCKET[4]
    largest = data['regions'][0]
    assert abs(largest['missing_mm3'] - volume) < 0.03 * volume
    assert abs(largest['deepest_mm'] - POCKET[4] * 1e3) < 0.05
    assert np.allclose(largest['box_mm'], np.array(POCKET[:4]) * 1e3, atol=0.8)
    assert (out / 'missing.png').stat().st_size > 10_000
    depth = load_map(out / 'missing.npz')
    assert abs(depth.sample(0.135, -0.002) - POCKET[4]) < 0.05e-3

    from waam_plan.layers.restore import plan_restoration
    from waam_plan.mesh.part import load_part
    from waam_plan.mesh.surface import top_surface
    from waam_plan.settings import PlanSettings

    part = load_part(files / 'nominal.stl', require_closed=False)
    worn = HeightGrid.load_npz(out / 'as_found.npz')
    offset = tuple(-float(v) for v in part.bounds[0])
    plan = plan_restoration(worn, top_surface(part.mesh, worn.spec, offset), PlanSettings())
    x = np.array([p[0] for t in plan.layers for s in t.segments if s.arc for p in (s.start, s.end)])
    assert plan.layers and x.min() > POCKET[0] - CORNER[0] - 2e-3
    assert x.max() < POCKET[1] - CORNER[0] + 2e-3


def test_search_finds_a_part_that_lies_anywhere(files):
    points = worn_cloud(np.random.default_rng(4), step=0.3e-3)
    c, s = np.cos(2.1), np.sin(2.1)
    np.save(
        files / 'far.npy',
        (points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [0.3, 0.1, 0]) * 1e3,
    )
    out = files / 'far'
    words = (
        'compare',
        files / 'nominal.stl',
        files / 'far.npy',
        '--register',
        '--search',
        '--out',
        out,
    )
    assert run(*words) == 0
    largest = json.loads((out / 'missing.json').read_text())['regions'][0]
    volume = 1e9 * (POCKET[1] - POCKET[0]) * (POCKET[3] - POCKET[2]) * POCKET[4]
    assert abs(largest['missing_mm3'] - volume) < 0.05 * volume


def test_register_prints_and_saves(files, capsys):
    out = files / 'registered'
    words = ('register', files / 'worn.npy', files / 'nominal.stl', '--change', 'wear', '--moved')
    assert run(*words, '--out', out) == 0
    assert 'standard uncertainty' in capsys.readouterr().out
    data = json.loads((out / 'registration.json').read_text())
    assert abs(data['roll_pitch_yaw_deg'][2] + 0.6) < 0.05
    assert np.allclose(data['shift_of_centre_mm'], [-1.2, 0.8, -0.5], atol=0.05)
    assert data['unobserved'] == []
    assert (out / 'registration.png').stat().st_size > 10_000
    moved = load_points(out / 'moved.ply')
    assert len(moved) == len(load_points(files / 'worn.npy'))


def test_planner_frame_puts_the_corner_of_the_part_at_zero():
    grid = nominal_grid(nominal(), 1e-3)
    work = planner_frame(grid, nominal())
    assert np.isclose(np.nanmax(work.z), SIZE[2], atol=1e-6)
    assert np.isclose(work.spec.origin_x, -4e-3) and np.isclose(work.spec.origin_y, -4e-3)


@pytest.mark.parametrize(
    'words, text',
    [
        (('compare', 'nominal.stl', 'none.ply'), 'none.ply: no such file'),
        (('compare', 'none.stl', 'worn.npy'), 'none.stl'),
        (('compare', 'nominal.stl', 'worn.npy', '--cell', '0'), '--cell'),
        (('compare', 'nominal.stl', 'worn.npy', '--search'), '--register'),
        (('compare', 'nominal.stl', 'nominal.stl'), 'not a cloud'),
        (('register', 'worn.npy'), 'SCAN and REFERENCE'),
        (('register', 'worn.npy', 'bad.npy'), 'bad.npy'),
        (('register', 'worn.npy', 'bad.ply'), 'bad.ply'),
    ],
)
def test_bad_input_is_one_clear_line(files, capsys, words, text):
    (files / 'bad.npy').write_bytes(b'\x93NUMPY nonsense')
    (files / 'bad.ply').write_bytes(b'ply\nformat ascii 1.0\nend_header\n')
    words = [files / w if '.' in w and not w.startswith('-') else w for w in words]
    assert run(*words, '--out', files / 'none') == 1
    error = capsys.readouterr().err
    assert error.startswith('error: ') and text in error and error.count('\n') == 1


def test_meshes_are_told_from_clouds(files):
    assert is_mesh(files / 'nominal.stl') and not is_mesh(files / 'worn.npy')
    assert load_triangles(files / 'nominal.stl').shape[1:] == (3, 3)


def test_upright_walls_seen_from_above_do_not_show_where_a_part_slid(tmp_path, capsys):
    """No point lies on them: the plate stays where it is in its plane, and the report says so."""
    write_stl(tmp_path / 'plate.stl', box_triangles([0, 0, 0], [60, 40, 10]), 'plate')
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 0.06, 8_000), rng.uniform(0, 0.04, 8_000)
    z = 0.0103 + 20e-6 * rng.standard_normal(len(x))
    np.save(tmp_path / 'plate.npy', np.column_stack([x + 0.4e-3, y, z]) * 1e3)
    words = ('register', tmp_path / 'plate.npy', tmp_path / 'plate.stl', '--out', tmp_path)
    assert run(*words, '--change', 'any') == 0
    assert 'sliding on the plane with normal z' in capsys.readouterr().out
    data = json.loads((tmp_path / 'registration.json').read_text())
    assert data['shift_sigma_mm'][:2] == [None, None] and data['shift_sigma_mm'][2] < 0.005
    assert np.allclose(data['shift_of_centre_mm'], [0, 0, -0.3], atol=0.01)
