"""3MF, clouds, repair and crossings: what is read is right, what is wrong is named with its place."""

import io
import json
import re
import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.clouds import Cloud, cloud_grid, is_cloud, read_cloud
from waam_plan.mesh.inputs import flat, of_part
from waam_plan.mesh.part import PartError, load_part
from waam_plan.mesh.threemf import read_3mf
from waam_plan.preview.page import write_page
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec

CORE = 'http://schemas.microsoft.com/3dmanufacturing/core/2015/02'


def three_mf(unit='millimeter', transform='', nested=False, head=''):
    """A box of 30 x 20 x 10 units with its corner at zero."""
    box = trimesh.creation.box(extents=(30, 20, 10))
    box.apply_translation((15, 10, 5))
    vertices = ''.join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in box.vertices)
    faces = ''.join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box.faces)
    mesh = f'<object id="1"><mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object>'
    place = f' transform="{transform}"' if transform else ''
    if nested:
        mesh += f'<object id="2"><components><component objectid="1"{place}/></components></object>'
    item = f'<item objectid="{2 if nested else 1}"{place}/>'
    text = f'{head}<model unit="{unit}" xmlns="{CORE}"><resources>{mesh}</resources><build>{item}</build></model>'
    out = io.BytesIO()
    with zipfile.ZipFile(out, 'w', zipfile.ZIP_DEFLATED) as z:
        z.writestr('3D/3dmodel.model', text)
    return out.getvalue()


@pytest.mark.parametrize(('unit', 'metres'), [('millimeter', 1e-3), ('inch', 0.0254)])
def test_3mf_knows_its_unit(tmp_path, unit, metres):
    path = tmp_path / 'box.3mf'
    path.write_bytes(three_mf(unit))
    part = load_part(path, scale=1.0)
    size = part.bounds[1] - part.bounds[0]
    np.testing.assert_allclose(size, np.array((30, 20, 10)) * metres)
    assert part.report.closed and part.report.volume == pytest.approx(6000 * metres**3)


def test_3mf_transforms_are_applied_from_the_inside_out():
    turn = '0 1 0 -1 0 0 0 0 1 100 0 0'  # x to y, y to -x, then 100 along x
    vertices, *_ = read_3mf(three_mf(transform=turn))
    np.testing.assert_allclose(vertices.min(axis=0), (0.080, 0, 0), atol=1e-12)
    twice, *_ = read_3mf(three_mf(transform=turn, nested=True))
    np.testing.assert_allclose(twice.max(axis=0), (0.100, 0.100, 0.010), atol=1e-12)


@pytest.mark.parametrize(
    ('data', 'word'),
    [
        (b'PK no archive', 'archive'),
        (three_mf(unit='furlong'), 'furlong'),
        (three_mf(transform='1 2 3'), '12 are needed'),
        (three_mf(head='<!DOCTYPE a [<!ENTITY b "c">]>'), 'document type'),
        (three_mf()[:300], 'archive'),
    ],
)
def test_a_bad_3mf_is_refused_by_name(tmp_path, data, word):
    path = tmp_path / 'bad.3mf'
    path.write_bytes(data)
    with pytest.raises(PartError, match=word) as caught:
        load_part(path)
    assert str(path) in str(caught.value)


@given(st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_damaged_3mf_never_raises_anything_else(data):
    raw = bytearray(three_mf())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        vertices, faces, _ = read_3mf(bytes(raw))
    except ValueError:
        return
    assert faces.max() < len(vertices)


def hills(n=40_000, seed=1):
    """A worn zone of 60 x 30 mm, mm: a trough 3 mm deep, scattered points."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 60, n), rng.uniform(0, 30, n)
    return np.column_stack([x + 200, y - 50, 20 - 3 * np.exp(-(((x - 30) / 12) ** 2))])


def pcd(points, kind):
    head = (
        f'# .PCD v0.7\nVERSION 0.7\nFIELDS rgb x y z\nSIZE 4 4 4 4\nTYPE U F F F\nCOUNT 1 1 1 1\nWIDTH {len(points)}\n'
        f'HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {kind}\n'
    ).encode()
    if kind == 'ascii':
        return head + b''.join(b'7 %.4f %.4f %.4f\n' % tuple(p) for p in points)
    rows = np.zeros(len(points), [('rgb', '<u4'), ('p', '<f4', 3)])
    rows['p'] = points
    return head + rows.tobytes()


@pytest.mark.parametrize('kind', ['binary.pcd', 'ascii.pcd', 'xyz', 'csv', 'npy', 'ply'])
def test_clouds_of_all_kinds_give_the_same_points(tmp_path, kind):
    points = hills(500)
    path = tmp_path / f'cloud.{kind}'
    if kind.endswith('pcd'):
        path.write_bytes(pcd(points, kind.split('.')[0]))
    elif kind == 'npy':
        np.save(path, points)
    elif kind == 'ply':
        trimesh.PointCloud(points).export(path)
    else:
        np.savetxt(path, points, delimiter=';' if kind == 'csv' else ' ', header='x y z')
    assert is_cloud(path)
    np.testing.assert_allclose(read_cloud(path).points, points * 1e-3, atol=1e-7)


def test_a_mesh_in_a_ply_is_no_cloud(tmp_path):
    trimesh.creation.box().export(tmp_path / 'box.ply')
    assert not is_cloud(tmp_path / 'box.ply')


@pytest.mark.parametrize(
    ('name', 'data', 'word'),
    [
        ('a.pcd', b'FIELDS x y z\n', 'no DATA'),
        ('a.pcd', pcd(hills(500), 'binary')[:-40], 'truncated'),
        ('a.pcd', pcd(hills(500), 'binary').replace(b'DATA binary', b'DATA binary_compressed'), 'save it as'),
        ('a.xyz', b'nothing here', 'no line with numbers'),
        ('a.csv', b'1,2\n3,4\n', 'not a readable'),
    ],
)  # fmt: skip
def test_bad_clouds_are_refused_by_name(tmp_path, name, data, word):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(PartError, match=word) as caught:
        read_cloud(tmp_path / name)
    assert name in str(caught.value)


def test_the_grid_of_a_cloud_is_its_surface_without_splashes():
    points = hills() * 1e-3
    points[::500, 2] += 8e-3
    spec = GridSpec.covering(0.2, -0.05, 0.26, -0.02, 0.5e-3)
    grid = cloud_grid(points, spec)
    x, _ = np.meshgrid(spec.x - 0.2, spec.y)
    truth = 0.020 - 0.003 * np.exp(-(((x - 0.03) / 0.012) ** 2))
    known = np.isfinite(grid.z)
    assert known.mean() > 0.97 and np.abs(grid.z - truth)[known].max() < 0.3e-3


def test_a_scanned_zone_without_a_part_becomes_flat():
    s = PlanSettings()
    zone = flat(Cloud(hills() * 1e-3, []), s)
    plan = plan_restoration(zone.found, zone.nominal, s)
    level = np.nanmax(zone.nominal.z)
    np.testing.assert_allclose(plan.final_target[plan.region], level, atol=1e-9)
    assert plan.region.sum() * 0.25e-6 == pytest.approx(60e-3 * 30e-3, rel=0.05)
    assert len(plan.layers) == 2 or len(plan.layers) == 3
    lower = flat(Cloud(hills() * 1e-3, []), s, level=0.020)
    assert np.nanmax(lower.nominal.z) == pytest.approx(level - s.layer_height, abs=0.1e-3)


def test_only_the_scanned_zone_of_a_part_is_planned(tmp_path, box_file):
    points = hills() - (200, -50, 0) + (5, 8, 0)
    np.save(tmp_path / 'zone.npy', points + (-30, -20, -10))  # the box has its middle at zero
    part = load_part(box_file())
    args = (part, tmp_path / 'zone.npy', 1e-3, PlanSettings())
    zone = of_part(*args, zone=True)
    assert (
        np.isfinite(zone.nominal.z).sum() < 0.9 * np.isfinite(of_part(*args, False).nominal.z).sum()
    )
    plan = plan_restoration(zone.found, zone.nominal, PlanSettings())
    assert plan.layers and plan.bounds[1] > 6e-3


def test_crossing_faces_are_named_with_a_place(tmp_path):
    one, two = trimesh.creation.box(extents=(20, 20, 20)), trimesh.creation.box(extents=(8, 8, 40))
    two.apply_translation((3, 2, 0))
    trimesh.util.concatenate([one, two]).export(tmp_path / 'both.stl')
    found = load_part(tmp_path / 'both.stl', look_for_crossings=True).report.crossing
    x, y, z = (
        float(v) for v in re.search(r'\(([-\d.]+), ([-\d.]+), ([-\d.]+)\) mm', found).groups()
    )
    assert abs(z) == pytest.approx(10) and -1.1 <= x <= 7.1 and -2.1 <= y <= 6.1
    one.export(tmp_path / 'one.stl')
    assert load_part(tmp_path / 'one.stl', look_for_crossings=True).report.crossing == ''
    ball = trimesh.creation.icosphere(3, 20)
    ball.export(tmp_path / 'ball.stl')
    assert load_part(tmp_path / 'ball.stl', look_for_crossings=True).report.crossing == ''


def test_repair_closes_holes_and_turns_faces_and_says_so(tmp_path):
    box = trimesh.creation.box(extents=(60, 40, 20)).subdivide()
    faces = np.delete(box.faces, [0, 5], axis=0)
    faces[7] = faces[7][::-1]
    faces = np.concatenate([faces, faces[11:12]])
    path = tmp_path / 'torn.ply'
    trimesh.Trimesh(box.vertices, faces, process=False).export(path)
    with pytest.raises(PartError):
        load_part(path)
    part = load_part(path, repair=True)
    assert part.report.closed and part.report.volume == pytest.approx(4.8e-5, rel=0.02)
    told = ' '.join(part.report.repairs)
    assert 'double faces' in told and 'hole of ' in told and ' mm' in told
    assert plan_build(part, PlanSettings(overrun=0.0), 2).volume == pytest.approx(
        60e-3 * 40e-3 * 4e-3, rel=0.05
    )


def test_inverted_mesh_is_turned(tmp_path, box_file):
    mesh = trimesh.load(box_file())
    mesh.invert()
    mesh.export(tmp_path / 'in.stl')
    with pytest.raises(PartError, match='--repair'):
        load_part(tmp_path / 'in.stl')
    assert load_part(tmp_path / 'in.stl', repair=True).report.volume > 0


def test_the_page_holds_all_it_needs(tmp_path, box_file):
    plan = plan_build(load_part(box_file((40, 30, 6))), PlanSettings())
    plan.warnings.append('</script><b>look')
    write_page(plan, tmp_path / 'p.html')
    text = (tmp_path / 'p.html').read_text()
    assert 'http' not in text and 'src=' not in text
    assert '&lt;/script&gt;&lt;b&gt;look' in text and text.count('</script>') == 1
    data = json.loads(re.search(r'const PLAN=(.*?);\n', text).group(1))
    arcs = [run for runs in data['layers'] for run in runs if run[0]]
    points = np.concatenate([np.reshape(run[1], (-1, 3)) for run in arcs]) * 1e-5
    ends = np.array([s.end for p in plan.layers for s in p.deposits])
    np.testing.assert_allclose(points.max(axis=0), ends.max(axis=0), atol=1e-5)
    assert text.count('<tr><td>') == len(plan.layers)
