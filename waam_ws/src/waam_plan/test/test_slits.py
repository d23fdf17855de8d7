"""Pieces of a layer that stand near to each other: what covers them does not meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from shapely import Point, box

from waam_plan.layers.build import plan_build
from waam_plan.layers.sides import of_section
from waam_plan.mesh.part import load_part
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import raster
from waam_process.grid import GridSpec

S = PlanSettings(grid=1e-3)


@pytest.mark.parametrize('strategy', ['zigzag', 'contour'])
@pytest.mark.parametrize('slit', [0.3, 1.2, 2.3])
def test_a_narrow_slit_does_not_cut_every_bead(tmp_path, strategy, slit):
    """As below the point of a teardrop. Covers that met made one region of both pieces, and each bead lost the arc
    between them."""
    left, right = (trimesh.creation.box(bounds=[[0, 0, 0], [28, 20, 4]]) for _ in range(2))
    right.apply_translation((28 + slit, 0, 0))
    turn = trimesh.transformations.rotation_matrix(np.radians(45), (0, 0, 1))
    both = trimesh.util.concatenate([left, right])
    both.apply_transform(turn)
    both.export(tmp_path / 'slit.stl')
    part = load_part(tmp_path / 'slit.stl')
    for grid in (S.grid, S.grid / 2):
        plan = plan_build(part, replace(S, strategy=strategy, grid=grid), 1)
        assert plan.arc_starts == 2
        assert plan.layers[0].footprint.sum() * grid**2 == pytest.approx(
            2 * 28e-3 * 20e-3, rel=0.05
        )


def test_a_slit_around_an_island_stays_free():
    ring = Point(0, 0).buffer(30e-3).difference(Point(0, 0).buffer(16e-3))
    pieces = [ring, Point(0, 0).buffer(15e-3)]
    spec = GridSpec.covering(-0.04, -0.04, 0.04, 0.04, S.grid)
    cover = of_section(pieces, raster(pieces, spec), spec, S)
    assert len(cover.polygons) == 2
    assert cover.polygons[0].distance(cover.polygons[1]) > S.grid
    assert (cover.metal | ~raster(pieces, spec)).all()  # what is asked for gets metal
    far = [pieces[1], box(0.02, -0.02, 0.04, 0.02)]
    one, two = of_section(far, raster(far, spec), spec, S).polygons
    whole = sorted(p.buffer(S.overrun, join_style='mitre').area for p in far)
    assert sorted([one.area, two.area]) == pytest.approx(whole, rel=1e-9)
