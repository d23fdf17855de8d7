"""Planning rules of source 003 that are off by default: shrinkage and compensation layer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.part import load_part
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings

S = PlanSettings(grid=1e-3)


@pytest.fixture
def part_of(tmp_path):
    def make(mesh, name='part'):
        file = tmp_path / f'{name}.stl'
        mesh.export(file)
        return load_part(file)

    return make


def block(x, y, z):
    return trimesh.creation.box(bounds=[[0, 0, 0], [x, y, z]])


# ---- shape -------------------------------------------------------------------------------------


def test_a_build_is_larger_by_what_it_shrinks(part_of):
    part = part_of(block(40, 30, 8))
    fine = replace(S, grid=0.25e-3)
    plain, larger = (plan_build(part, replace(fine, shrinkage=s)) for s in (0.0, 0.05))
    areas = [p.layers[0].footprint.sum() for p in (plain, larger)]
    assert areas[1] / areas[0] == pytest.approx(1 / 0.95**2, rel=0.01)
    tops = [float(np.nanmax(p.final_target)) for p in (plain, larger)]
    assert tops[1] / tops[0] == pytest.approx(1 / 0.95)
    assert larger.remarks == ['scaled by 1.0526 against a shrinkage of 5.00%'] and not plain.remarks


def test_a_compensation_layer_lies_below_the_part(part_of):
    part = part_of(block(30, 24, 6))
    plain = plan_build(part, S)
    raised = plan_build(part, replace(S, compensation_height=12e-3))
    assert len(raised.layers) == len(plain.layers) + 6
    assert np.nanmax(raised.final_target) == pytest.approx(np.nanmax(plain.final_target) + 12e-3)
    assert raised.offset[2] == pytest.approx(plain.offset[2] + 12e-3)
    for n, p in enumerate(raised.layers):
        assert p.number == n + 1
        assert (p.footprint == plain.layers[0].footprint).all()
    assert 'compensation layer: 12.0 mm in 6 layers' in raised.remarks[0]
    assert len(plan_build(part, replace(S, compensation_height=12e-3), 2).layers) == 2


# ---- off ---------------------------------------------------------------------------------------


def test_a_restoration_refuses_what_only_builds_know(worn_block):
    with pytest.raises(PlanError, match='compensation_height, shrinkage: only a build knows this'):
        plan_restoration(*worn_block(0.002), replace(S, shrinkage=0.01, compensation_height=0.01))
