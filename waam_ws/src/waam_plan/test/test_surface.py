import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.mesh.surface import top_surface
from waam_process.grid import GridSpec

SPEC = GridSpec.covering(-0.01, -0.01, 0.01, 0.01, 0.5e-3)


def test_box_is_flat_inside_and_unknown_outside():
    top = top_surface(trimesh.creation.box(extents=(0.01, 0.006, 0.004)), SPEC)
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    inside = (abs(x) < 0.005) & (abs(y) < 0.003)
    np.testing.assert_allclose(top.z[inside], 0.002, atol=1e-12)
    assert np.isnan(top.z[~inside]).all()


def test_offset_moves_the_part():
    box = trimesh.creation.box(extents=(0.004, 0.004, 0.004))
    top = top_surface(box, SPEC, (0.003, -0.002, 0.1))
    row, col = SPEC.cell(0.003, -0.002)
    assert top.z[row, col] == pytest.approx(0.102)


@given(st.tuples(*[st.floats(-1, 1)] * 2), st.floats(-0.005, 0.005), st.integers(0, 2**31))
@settings(max_examples=30, deadline=None)
def test_a_plane_of_random_triangles_is_exact_and_without_gaps(slope, height, seed):
    rng = np.random.default_rng(seed)
    from scipy.spatial import Delaunay

    corners = [(-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (-0.02, 0.02)]
    points = np.concatenate([corners, rng.uniform(-0.015, 0.015, (30, 2))])
    z = height + points @ np.array(slope)
    mesh = trimesh.Trimesh(np.column_stack([points, z]), Delaunay(points).simplices, process=False)
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    np.testing.assert_allclose(
        top_surface(mesh, SPEC).z, height + slope[0] * x + slope[1] * y, atol=1e-9
    )


def test_the_upper_of_two_surfaces_wins():
    low = trimesh.creation.box(extents=(0.01, 0.01, 0.002))
    high = trimesh.creation.box(extents=(0.004, 0.004, 0.010))
    top = top_surface(trimesh.util.concatenate([low, high]), SPEC)
    row, col = SPEC.cell([0.0005, 0.004], [0.0005, 0.004])
    np.testing.assert_allclose(top.z[row, col], (0.005, 0.001), atol=1e-12)


def test_sphere_within_its_facets():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.008)
    top = top_surface(ball, SPEC)
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    r2 = x**2 + y**2
    inner = r2 < 0.007**2
    np.testing.assert_allclose(top.z[inner], np.sqrt(0.008**2 - r2[inner]), atol=3e-5)
