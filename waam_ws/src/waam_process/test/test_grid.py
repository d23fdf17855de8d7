import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_process.grid import GridError, GridSpec, HeightGrid

SPEC = GridSpec(-0.01, 0.02, 0.5e-3, 40, 60)


def plane(spec, a=0.1, b=-0.2, c=0.003):
    x, y = np.meshgrid(spec.x, spec.y)
    return HeightGrid(spec, a * x + b * y + c)


def test_covering_contains_its_corners_and_is_the_smallest():
    spec = GridSpec.covering(0.0, 0.0, 0.0101, 0.02, 1e-3)
    assert spec.shape == (20, 11)
    assert GridSpec.covering(0.0, 0.0, 0.01, 0.02, 1e-3).shape == (20, 10)


@given(st.integers(0, 39), st.integers(0, 59))
def test_cell_centres_lie_in_their_cells(row, col):
    assert SPEC.cell(SPEC.x[col], SPEC.y[row]) == (row, col)
    assert SPEC.contains(SPEC.x[col], SPEC.y[row])


def test_outside_points_are_not_contained():
    x0, x1, y0, y1 = SPEC.extent
    assert not SPEC.contains(x0 - 1e-6, y0)
    assert not SPEC.contains(x1 + 1e-9, y1 - 1e-6)


@given(st.floats(0.02, 0.98), st.floats(0.02, 0.98))
def test_sampling_a_plane_is_exact(u, v):
    x0, x1, y0, y1 = SPEC.extent
    x, y = x0 + u * (x1 - x0), y0 + v * (y1 - y0)
    assert plane(SPEC).sample(x, y) == pytest.approx(0.1 * x - 0.2 * y + 0.003, abs=1e-12)


def test_holes_do_not_leak_and_outside_is_unknown():
    grid = plane(SPEC)
    z = grid.z.copy()
    z[10:20, 10:20] = np.nan
    holed = grid.with_z(z)
    assert np.isnan(holed.sample(SPEC.x[15], SPEC.y[15]))
    edge = holed.sample(0.5 * (SPEC.x[9] + SPEC.x[10]), SPEC.y[15])
    assert edge == pytest.approx(z[15, 9])
    assert np.isnan(holed.sample(-1.0, 0.03))
    assert holed.coverage == pytest.approx(1 - 100 / (40 * 60))


def test_save_and_load_give_the_same_map(tmp_path):
    grid = HeightGrid(SPEC, plane(SPEC).z, np.full(SPEC.shape, 1e-5))
    grid.save_npz(tmp_path / 'map.npz')
    back = HeightGrid.load_npz(tmp_path / 'map.npz')
    assert back.spec == SPEC
    assert np.array_equal(back.z, grid.z)
    assert np.array_equal(back.sigma, grid.sigma)


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        ((0, 0, 0.0, 3, 3), 'resolution'),
        ((0, 0, np.nan, 3, 3), 'resolution'),
        ((np.inf, 0, 1e-3, 3, 3), 'origin'),
        ((0, 0, 1e-3, 0, 3), '0 x 3'),
        ((0, 0, 1e-9, 2**14, 2**14), 'not usable'),
    ],
)
def test_impossible_geometry_is_refused(arguments, word):
    with pytest.raises(GridError, match=word):
        GridSpec(*arguments)


def test_shape_must_fit_the_grid():
    with pytest.raises(GridError, match='heights have shape'):
        HeightGrid(SPEC, np.zeros((3, 3)))
    with pytest.raises(GridError, match='sigma has shape'):
        HeightGrid(SPEC, np.zeros(SPEC.shape), np.zeros((3, 3)))
