"""Parts on the table: plates and STL files."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_process.grid import GridSpec, HeightGrid
from waam_sim.part import PartError, centre, from_file, from_stl, plate

CELL, MARGIN = 4e-4, 0.01


def test_plate_volume_and_rim():
    part = plate(0.05, 0.03, 0.01, CELL, MARGIN)
    assert part.z.sum() * CELL**2 == pytest.approx(0.05 * 0.03 * 0.01, rel=1e-9)
    assert part.spec.extent[0] == pytest.approx(-MARGIN) and part.z[0, 0] == 0.0
    assert centre(part) == pytest.approx((0.025, 0.015), abs=CELL)


@pytest.mark.parametrize('size', [(0.0, 0.03, 0.01), (0.05, float('nan'), 0.01), (0.05, 0.03, 9.0)])
def test_bad_plates_are_refused(size):
    with pytest.raises(PartError, match='plate'):
        plate(*size, CELL, MARGIN)


@settings(max_examples=10, deadline=None)
@given(x=st.floats(10, 80), y=st.floats(10, 60), z=st.floats(2, 30), dx=st.floats(-200, 200))
def test_stl_box_comes_out_as_a_box_at_the_origin(tmp_path_factory, x, y, z, dx):
    mesh = trimesh.creation.box((x, y, z))
    mesh.apply_translation((dx, -dx, 3 * dx))
    path = str(tmp_path_factory.mktemp('stl') / 'box.stl')
    mesh.export(path)
    part = from_stl(path, CELL, MARGIN)
    xs, ys = np.meshgrid(part.spec.x, part.spec.y)
    e = 1e-6
    inside = (xs > e) & (xs < x * 1e-3 - e) & (ys > e) & (ys < y * 1e-3 - e)
    outside = (xs < -e) | (xs > x * 1e-3 + e) | (ys < -e) | (ys > y * 1e-3 + e)
    assert np.abs(part.z[inside] - z * 1e-3).max() < 1e-6
    assert (part.z[outside] == 0).all()


def test_top_surface_wins_over_what_lies_below(tmp_path):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=15.0)
    path = tmp_path / 'ball.stl'
    mesh.export(path)
    part = from_stl(str(path), CELL, MARGIN)
    x, y = np.meshgrid(part.spec.x - 0.015, part.spec.y - 0.015)
    r2 = x**2 + y**2
    near = r2 < 0.012**2
    assert np.abs(part.z - (0.015 + np.sqrt(np.maximum(0.015**2 - r2, 0))))[near].max() < 1.5e-4


def test_files_that_are_no_parts_are_refused_by_name(tmp_path):
    with pytest.raises(PartError, match='no such file'):
        from_stl(str(tmp_path / 'none.stl'), CELL, MARGIN)
    junk = tmp_path / 'junk.stl'
    junk.write_bytes(b'this is no mesh')
    with pytest.raises(PartError, match='junk.stl'):
        from_stl(str(junk), CELL, MARGIN)
    huge = tmp_path / 'huge.stl'
    trimesh.creation.box((2000, 10, 10)).export(huge)
    with pytest.raises(PartError, match='2000.0 x 10.0 x 10.0 mm'):
        from_stl(str(huge), CELL, MARGIN)


def test_a_height_map_lies_where_it_is(tmp_path):
    """In the work frame, not moved to its corner; on the cells of the plant, whatever its own are."""
    spec = GridSpec(-0.004, 0.002, 1e-3, 30, 40)
    z = np.where((np.arange(40) > 9) & (np.arange(30)[:, None] > 5), 0.013, 0.0)
    HeightGrid(spec, z).save_npz(tmp_path / 'part.npz')
    part = from_file(str(tmp_path / 'part.npz'), CELL, MARGIN)
    assert part.spec.resolution == CELL and part.spec.extent[0] == pytest.approx(-0.004)
    assert part.sample(0.0085, 0.0100) == pytest.approx(0.013)
    assert part.sample(0.0040, 0.0100) == part.sample(0.0085, 0.0060) == 0.0
    assert set(np.unique(part.z)) == {0.0, 0.013}
    same = from_file(str(tmp_path / 'part.npz'), 1e-3, MARGIN)
    np.testing.assert_array_equal(same.z, z)


@pytest.mark.parametrize(
    ('change', 'told'),
    [
        (lambda z: np.where(z > 0, np.nan, z), 'without a height'),
        (lambda z: z - 0.01, 'below the table'),
        (lambda z: z + 0.6, 'too large'),
    ],
)
def test_a_height_map_that_is_no_part_is_refused(tmp_path, change, told):
    z = change(np.where(np.arange(20) > 9, 0.01, 0.0) * np.ones((20, 1)))
    HeightGrid(GridSpec(0.0, 0.0, 1e-3, 20, 20), z).save_npz(tmp_path / 'part.npz')
    with pytest.raises(PartError, match=told):
        from_file(str(tmp_path / 'part.npz'), CELL, MARGIN)
    (tmp_path / 'part.npz').write_bytes(b'PK\\x03\\x04 nothing')
    with pytest.raises(PartError, match='not a height map'):
        from_file(str(tmp_path / 'part.npz'), CELL, MARGIN)
