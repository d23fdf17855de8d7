"""Sections against shapes whose section is known."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, contains_xy

from waam_plan.slice.section import merged, raster, section_polygons, section_rings
from waam_process.grid import GridSpec


def cut(mesh, z):
    return section_polygons(np.asarray(mesh.vertices), np.asarray(mesh.faces), z)


@given(st.floats(-0.95, 0.95))
@settings(max_examples=30, deadline=None)
def test_sphere(z):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    (polygon,) = cut(ball, z)
    assert polygon.area == pytest.approx(math.pi * (1 - z * z), rel=0.02)


def test_a_plane_through_vertices_is_no_special_case():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    for z in np.unique(ball.vertices[:, 2].round(12))[1:-1]:
        exact = ball.vertices[np.argmin(abs(ball.vertices[:, 2] - z)), 2]
        assert sum(p.area for p in cut(ball, exact)) == pytest.approx(
            math.pi * (1 - exact**2), rel=0.1, abs=0.02
        )


def test_tube_has_a_hole_and_outside_there_is_nothing():
    tube = trimesh.creation.annulus(r_min=0.01, r_max=0.02, height=0.04)
    (polygon,) = cut(tube, 0.0)
    assert len(polygon.interiors) == 1
    assert polygon.area == pytest.approx(math.pi * 3e-4, rel=0.02)
    assert cut(tube, 0.03) == []


def test_island_in_a_hole_and_overlapping_bodies():
    tube = trimesh.creation.annulus(r_min=0.01, r_max=0.02, height=0.04)
    pin = trimesh.creation.cylinder(radius=0.005, height=0.04)
    assert len(cut(trimesh.util.concatenate([tube, pin]), 0.0)) == 2
    a, b = trimesh.creation.box(extents=(2, 2, 2)), trimesh.creation.box(extents=(2, 2, 2))
    b.apply_translation((1, 0.5, 0))
    (polygon,) = cut(trimesh.util.concatenate([a, b]), 0.1)
    assert polygon.area == pytest.approx(8 - 1.5)


def test_rings_turn_left_around_metal():
    tube = trimesh.creation.annulus(r_min=0.01, r_max=0.02, height=0.04)
    rings = section_rings(np.asarray(tube.vertices), np.asarray(tube.faces), 0.001)
    areas = []
    for r in rings:
        x, y = r.T
        areas.append(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    assert max(areas) > 0 > min(areas)


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=3, max_size=12))
@settings(max_examples=60, deadline=None)
def test_raster_agrees_with_shapely(points):
    polygon = Polygon(points).buffer(0)
    spec = GridSpec(-1.1, -1.1, 0.0437, 50, 50)
    x, y = np.meshgrid(spec.x, spec.y)
    polygons = [p for p in getattr(polygon, 'geoms', [polygon]) if not p.is_empty]
    near = np.zeros(spec.shape, bool)
    if polygons:
        border = merged(polygons).boundary.buffer(1e-9)
        near = contains_xy(border, x, y)
    np.testing.assert_array_equal(raster(polygons, spec)[~near], contains_xy(polygon, x, y)[~near])
