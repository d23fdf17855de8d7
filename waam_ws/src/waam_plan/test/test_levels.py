"""Heights of layers: equal, or thinner where the surface slants."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_plan.layers.build import plan_build
from waam_plan.mesh.part import load_part
from waam_plan.plan import PlanError
from waam_plan.settings import MAX_LAYER_RATIO, PlanSettings
from waam_plan.slice.levels import adaptive_levels

S = PlanSettings(levels='adaptive')


def on_ground(mesh):
    mesh.apply_translation(-mesh.bounds[0])
    mesh.apply_scale(1e-3)
    return np.asarray(mesh.triangles)


def test_upright_walls_get_the_thickest_layers_and_slopes_thin_ones():
    box = adaptive_levels(on_ground(trimesh.creation.box(extents=(40, 40, 28))), S)
    assert len(box) == 10 and box[0].thickness == pytest.approx(2.8e-3)
    ball = adaptive_levels(on_ground(trimesh.creation.icosphere(4, 30)), S)
    thick = np.array([b.thickness for b in ball])
    middle = [b.thickness for b in ball if abs(b.z - 0.03) < 5e-3]
    assert min(middle) > 1.5 * thick[0] and thick.min() >= 0.55 * 2e-3


def test_a_step_of_the_part_ends_a_layer():
    low = trimesh.creation.box(extents=(40, 40, 9))
    high = trimesh.creation.box(extents=(20, 20, 15))
    high.apply_translation((0, 0, 3.0))
    triangles = on_ground(trimesh.util.concatenate([low, high]))
    assert any(b.top == pytest.approx(9e-3, abs=1e-6) for b in adaptive_levels(triangles, S))


@given(st.floats(5, 30), st.floats(5, 60), st.floats(0.2e-3, 2e-3))
@settings(max_examples=25, deadline=None)
def test_levels_fill_the_height_and_keep_their_limits(radius, height, cusp):
    s = PlanSettings(levels='adaptive', cusp=cusp)
    cone = on_ground(trimesh.creation.cone(radius, height, sections=24))
    levels = adaptive_levels(cone, s)
    assert levels[0].z == 0 and levels[-1].top == pytest.approx(height * 1e-3)
    for a, b in zip(levels, levels[1:], strict=False):
        assert a.top == pytest.approx(b.z)
    assert max(b.thickness for b in levels) <= 1.0001 * MAX_LAYER_RATIO * s.layer_height


def test_an_adaptive_build_is_planned_with_its_own_heights(tmp_path):
    path = tmp_path / 'cone.stl'
    trimesh.creation.cone(25, 40).export(path)
    plan = plan_build(load_part(path), S, 6)
    thick = {round(float(p.planned.max()), 6) for p in plan.layers}
    tops = [np.nanmax(p.target_after) for p in plan.layers]
    assert np.allclose(np.diff(tops), [p.planned.max() for p in plan.layers[1:]])
    assert thick and max(thick) <= 2.8e-3


def test_base_layers_are_slower_with_the_same_bead(tmp_path):
    path = tmp_path / 'box.stl'
    trimesh.creation.box(extents=(40, 30, 8)).export(path)
    plan = plan_build(load_part(path), PlanSettings(base_layers=2, base_speed=0.7))
    base, later = plan.layers[0].deposits, plan.layers[2].deposits
    for a, b in zip(base, later, strict=True):
        assert a.speed == pytest.approx(0.7 * b.speed, rel=1e-6) and a.height == b.height
        assert a.speed_programmed == a.speed


def test_overhang_is_flagged_with_its_place_when_asked(tmp_path):
    foot = trimesh.creation.box(extents=(20, 20, 20))
    roof = trimesh.creation.box(extents=(60, 20, 10))
    roof.apply_translation((0, 0, 15))
    path = tmp_path / 'tee.stl'
    trimesh.util.concatenate([foot, roof]).export(path)
    with pytest.raises(PlanError, match='overhang of 8'):
        plan_build(load_part(path), PlanSettings())
    plan = plan_build(load_part(path), PlanSettings(overhang='flag'))
    assert len(plan.layers) == 15
    assert any('overhang of 8' in w and 'layer 11' in w and ' mm' in w for w in plan.warnings)
