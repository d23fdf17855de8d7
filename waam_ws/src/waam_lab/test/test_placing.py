"""The laboratory puts the worn part where `waam plan` expects it, and warns of what the planner warns of."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from waam_job.model.goal import check, planner_fields
from waam_lab import parts, restore, run
from waam_lab.laboratory import on_table, physics_of
from waam_lab.params import make
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.placed import surfaces_of
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings

WIDE = 3.0  # mm, cut off


def cut(worn: trimesh.Trimesh) -> trimesh.Trimesh:
    """Without the end at low x and without the floor: its bounding box has another corner."""
    lying = worn.slice_plane((WIDE, 0, 0), (1, 0, 0))
    return lying.slice_plane((0, 0, 4.0), (0, 0, 1))


def planned(job) -> Plan:
    """As `waam plan`, with the settings of the job."""
    checked = check(job.goal)
    settings = PlanSettings(**planner_fields(job.goal, checked.material))
    surfaces = surfaces_of(checked.in_file, job.as_found, job.goal.scale, settings)
    return plan_restoration(surfaces.found, surfaces.nominal, settings)


def written(folder: Path, scale: float, moved: np.ndarray, change=lambda mesh: mesh):
    nominal, worn = parts.worn_l().meshes()
    worn = change(worn)
    for name, mesh in (('nominal', nominal), ('worn', worn)):
        mesh.apply_translation(moved)
        mesh.apply_scale(1e-3 / scale)
        mesh.export(folder / f'{name}.stl')
    return restore(folder / 'nominal.stl', folder / 'worn.stl', scale=scale)


@pytest.mark.parametrize('scale', [1e-3, 1.0, 0.0254])
def test_a_worn_part_without_its_corner_stays_where_it_is(tmp_path, scale):
    job = written(tmp_path, scale, np.array([31.0, -12.0, 7.0]), cut)
    known = make({})
    heights = on_table(job, check(job.goal), known, physics_of(job, known)).heights
    whole = written(tmp_path, 1e-3, np.zeros(3))
    wanted = on_table(whole, check(whole.goal), known, physics_of(whole, known)).heights
    x, y = np.meshgrid(wanted.spec.x, wanted.spec.y)
    inside = (x > 1e-3 * WIDE + 1e-3) & (x < 0.079) & (y > 1e-3) & (y < 0.027)
    there = heights.sample(x, y)
    np.testing.assert_allclose(there[inside], wanted.z[inside], atol=5e-6)


def test_the_laboratory_lays_the_layers_of_the_plan(tmp_path):
    job = written(tmp_path, 1.0, np.array([31.0, -12.0, 7.0]), cut)
    plan, result = planned(job), run(job)
    assert result.layers == len(plan.layers)
    assert abs(result.mean) < 0.3e-3


def test_what_does_not_lie_on_the_part_is_refused_by_name(tmp_path, capsys):
    from waam_lab.cli_campaign import run_campaign

    def sunk(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        mesh.apply_translation((0, 0, -20))
        return mesh

    job = written(tmp_path, 1e-3, np.zeros(3), sunk)
    with pytest.raises(ValueError, match='wholly below the part'):
        run(job)
    args = arguments(tmp_path, job)
    with pytest.raises(ValueError, match='wholly below the part'):
        run_campaign(args)


def arguments(folder: Path, job):
    import argparse

    from waam_lab.cli import register

    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    out = str(folder / 'out')
    given = ['lab', str(job.goal.part), '--as-found', str(job.as_found), '--seeds', '1']
    return parser.parse_args([*given, '--workers', '1', '--out', out, '--layers', '1'])


def test_warnings_of_the_plan_are_shown_once_with_their_place(tmp_path, capsys):
    """A hump of 3 mm on the worn top, 14 mm across: nothing can lower it."""

    def with_hump(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        hump = trimesh.creation.cylinder(7.0, 10.0)
        hump.apply_translation((14, 40, 18.0))
        return trimesh.util.concatenate([mesh, hump])

    job = written(tmp_path, 1e-3, np.zeros(3), with_hump)
    args = arguments(tmp_path, job)
    assert args.run_command(args) == 0
    said = capsys.readouterr().out.replace('\n', ' ')
    assert said.count('above nominal') == 1
    report = (tmp_path / 'out/report.html').read_text()
    assert report.count('above nominal') == 1 and 'machine it first' in report
    (plan_warning,) = (w for w in planned(job).warnings if 'above nominal' in w)
    assert 'around x = ' in plan_warning and 'mm2' in plan_warning
    assert json.loads((tmp_path / 'out/report.json').read_text())
