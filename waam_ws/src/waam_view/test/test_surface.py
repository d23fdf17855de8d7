"""Meshes, colours and the surface that the plan wants."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from waam_process.grid import GridSpec
from waam_view.surface import UNKNOWN, LayerPath, colours, mesh, picture


def spec(rows, cols, resolution=1e-3):
    return GridSpec(0.0, 0.0, resolution, rows, cols)


@given(st.integers(2, 12), st.integers(2, 12), st.integers(0, 2**31))
def test_triangles_never_touch_unknown_heights(rows, cols, seed):
    rng = np.random.default_rng(seed)
    z = rng.normal(size=(rows, cols))
    z[rng.random(z.shape) < 0.3] = np.nan
    m = mesh(spec(rows, cols), z, colours(z, -1, 1))
    assert np.isfinite(m.vertices).all() and np.isfinite(m.normals).all()
    assert len(m.vertices) == len(m.colours) == np.isfinite(z).sum()
    whole = np.isfinite(z[:-1, :-1] + z[1:, 1:])
    expected = (whole & np.isfinite(z[:-1, 1:])).sum() + (whole & np.isfinite(z[1:, :-1])).sum()
    assert len(m.triangles) == expected
    assert len(m.triangles) == 0 or m.triangles.max() < len(m.vertices)


def test_triangles_face_up():
    z = np.zeros((3, 4))
    m = mesh(spec(3, 4), z, colours(z, 0, 1))
    a, b, c = (m.vertices[m.triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_large_maps_are_thinned():
    z = np.zeros((1000, 1000), np.float32)
    m = mesh(spec(1000, 1000), z, colours(z, 0, 1))
    assert len(m.vertices) < 160_000
    assert m.vertices[:, 0].max() > 0.99


def test_diverging_colours_are_symmetric_about_white():
    rgb = colours(np.array([-1.0, 0.0, 1.0, np.nan, 9.0]), -1, 1).astype(int)
    assert rgb[0][2] > rgb[0][0] and rgb[2][0] > rgb[2][2]
    assert rgb[1].min() > 240
    assert tuple(rgb[3]) == UNKNOWN
    assert (rgb[4] == rgb[2]).all()


def test_pictures_show_large_y_at_the_top():
    values = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert (picture(values, 0, 1)[0] == colours(np.array([1.0]), 0, 1)[0]).all()


def test_planned_speed_is_that_of_the_nearest_segment():
    two = LayerPath(
        1, np.array([[0, 0, 0], [0, 0.01, 0]]), np.array([[0.02, 0, 0], [0.02, 0.01, 0]]),
        np.ones(2), np.ones(2), np.array([0.01, 0.02]),
    )  # fmt: skip
    assert two.planned_speed((0.01, 0.002, 0)) == 0.01
    assert two.planned_speed((0.01, 0.009, 0)) == 0.02
