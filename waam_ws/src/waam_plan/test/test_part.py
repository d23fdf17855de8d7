"""Every bad mesh gets one clear refusal; a good one is read in metres."""

import numpy as np
import pytest
import trimesh

from waam_plan.mesh.part import PartError, check_fits, load_part
from waam_plan.settings import PlanSettings


def refused(path, *words, **options):
    with pytest.raises(PartError) as caught:
        load_part(path, **options)
    text = str(caught.value)
    assert str(path) in text
    for word in words:
        assert word in text, f'{word!r} not in {text!r}'


def test_a_box_in_mm_becomes_metres(box_file):
    part = load_part(box_file())
    assert part.name == 'box'
    np.testing.assert_allclose(part.bounds[1] - part.bounds[0], (0.06, 0.04, 0.02), atol=1e-9)
    assert part.report.closed
    assert part.report.volume == pytest.approx(0.06 * 0.04 * 0.02)
    assert len(part.sha256) == 64


@pytest.mark.parametrize('kind', ['stl_ascii', 'ply', 'obj', 'off'])
def test_other_formats_give_the_same_part(tmp_path, kind):
    path = tmp_path / f'box.{kind.split("_")[0]}'
    trimesh.creation.box(extents=(60, 40, 20)).export(path, file_type=kind)
    assert load_part(path).report.volume == pytest.approx(4.8e-5)


def test_missing_file(tmp_path):
    refused(tmp_path / 'nothing.stl', 'no such file')


def test_folder_and_unknown_suffix(tmp_path):
    (tmp_path / 'a.stl').mkdir()
    refused(tmp_path / 'a.stl', 'cannot be read')
    refused(tmp_path / 'a.step', 'unknown kind of file')


def test_empty_file(tmp_path):
    (tmp_path / 'e.stl').write_bytes(b'')
    refused(tmp_path / 'e.stl', 'empty')


@pytest.mark.parametrize('keep', [10, 83, 84, 100, 684 - 1])
def test_truncated_binary(tmp_path, box_file, keep):
    path = tmp_path / 't.stl'
    path.write_bytes(box_file().read_bytes()[:keep])
    refused(path, 'truncated')


def test_truncated_text(tmp_path):
    path = tmp_path / 't.stl'
    text = trimesh.creation.box().export(file_type='stl_ascii')
    path.write_text(text[: len(text) // 2])
    refused(path, 'truncated text STL')


@pytest.mark.parametrize(
    'data', [bytes(range(256)) * 20, b'\xff' * 1000, b'solid nothing\nendsolid nothing\n']
)
def test_garbage(tmp_path, data):
    path = tmp_path / 'g.stl'
    path.write_bytes(data)
    refused(path)


def test_no_triangles(tmp_path):
    path = tmp_path / 'n.stl'
    path.write_bytes(b'\0' * 84)
    refused(path, 'empty mesh')


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_vertices_that_are_not_numbers(tmp_path, box_file, value):
    data = bytearray(box_file().read_bytes())
    data[84 + 50 * 3 + 12 : 84 + 50 * 3 + 16] = np.float32(value).tobytes()
    path = tmp_path / 'nan.stl'
    path.write_bytes(data)
    refused(path, 'not finite', 'face 3')


def test_wrong_units_say_which_would_fit(box_file):
    refused(box_file((0.06, 0.04, 0.02)), 'wrong units', '1 (m)')
    refused(box_file((60, 40, 20)), 'wrong units', '0.001 (mm)', scale=1.0)


@pytest.mark.parametrize('scale', [0.0, -1.0, float('nan')])
def test_bad_scale(box_file, scale):
    with pytest.raises(PartError, match='scale'):
        load_part(box_file(), scale)


def test_open_mesh_names_the_hole_and_is_fine_for_restoring(tmp_path):
    box = trimesh.creation.box(extents=(60, 40, 20))
    lid = box.face_normals[:, 2] > 0.9
    path = tmp_path / 'open.stl'
    trimesh.Trimesh(box.vertices, box.faces[~lid]).export(path)
    refused(path, 'open mesh', '4 boundary edges in 1 holes', '(0.0, 0.0, 10.0) mm')
    assert not load_part(path, require_closed=False).report.closed


def test_inverted_normals(tmp_path):
    box = trimesh.creation.box(extents=(60, 40, 20))
    path = tmp_path / 'in.stl'
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False).export(path)
    refused(path, 'inverted normals')


def test_one_flipped_face(tmp_path):
    box = trimesh.creation.box(extents=(60, 40, 20))
    faces = box.faces.copy()
    faces[0] = faces[0][::-1]
    path = tmp_path / 'flip.stl'
    trimesh.Trimesh(box.vertices, faces, process=False).export(path)
    refused(path, 'wound in different directions')


def test_non_manifold_edge(tmp_path):
    a = trimesh.creation.box(extents=(20, 20, 20))
    b = a.copy()
    b.apply_translation((20, 20, 0))
    path = tmp_path / 'touch.stl'
    trimesh.util.concatenate([a, b]).export(path)
    refused(path, 'non-manifold', '(10.0, 10.0,')


def test_flat_part(tmp_path):
    path = tmp_path / 'flat.stl'
    square = np.array([[0, 0, 0], [50, 0, 0], [50, 50, 0], [0, 50, 0]], float)
    faces = [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]
    trimesh.Trimesh(square, faces, process=False).export(path)
    refused(path)


def test_larger_than_the_machine(box_file):
    with pytest.raises(PartError, match='outside the machine: 500.0 mm along x'):
        check_fits(load_part(box_file((500, 40, 20))), PlanSettings())
