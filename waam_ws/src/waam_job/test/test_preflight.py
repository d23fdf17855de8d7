"""What needs no scan is refused before the machine is armed, and all of it at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from waam_job.model.geometry import part_grid
from waam_job.model.goal import Code, JobGoal, check
from waam_job.model.records import State
from waam_job.model.snapshots import Machine
from waam_job.run.control import Control
from waam_job.run.runner import JobRunner
from waam_job.run.settings import Settings
from waam_job.run.work_frame import reached
from waam_job.store.folder import JobFolder
from waam_process.grid import HeightGrid


def mushroom(roof: float = 60.0) -> trimesh.Trimesh:
    """A foot of 20 mm under a roof, mm."""
    foot = trimesh.creation.box((20, 20, 20))
    top = trimesh.creation.box((roof, 20, 10))
    top.apply_translation((0, 0, 15))
    return trimesh.util.concatenate([foot, top])


@pytest.fixture
def make_build(tmp_path, cell_class):
    """make_build(mesh in mm, **goal fields) -> (runner, cell) with a plate on the table."""

    def make(mesh, change=lambda cell: None, **fields):
        file = tmp_path / 'part.stl'
        mesh.export(file)
        fields = {'mode': 'build', **fields}
        checked = check(JobGoal(file, 'er70s-6', tmp_path, **fields))
        cell = cell_class(HeightGrid.full(part_grid(checked.bounds, 0.5e-3, 5e-3), 0.0))
        change(cell)
        folder = JobFolder.create(tmp_path, 'test')
        settings = Settings(lease_nodes=('bridge',))
        return JobRunner(cell, checked, folder, Control(), settings), cell

    return make


def refused(runner, cell) -> str:
    """The words of a job that ends before anything moves."""
    status = runner.run()
    assert status.state == State.FAILED
    assert not cell.executed and not {'ARM', 'HOME', 'SET_ZERO'} & set(cell.commands)
    assert not cell.record_calls or True not in cell.record_calls
    return status.message


def test_cell_overhang_wire_and_size_are_said_together(make_build):
    def low_on_gas(cell):
        cell.machine_state = replace(cell.machine_state, state='HOLD', fault_text='gas is low')

    runner, cell = make_build(mushroom(450.0), low_on_gas, wire_left=0.5)
    said = refused(runner, cell)
    for words in (
        'gas is low',
        'overhang of 8',
        '450.0 mm along x',
        'm of wire are needed, 0.5 m are',
    ):
        assert words in said, words
    assert runner.status.error_code == Code.MACHINE_NOT_READY


@pytest.mark.parametrize(
    'mesh,words',
    [
        (mushroom(), 'overhang of 8'),
        (trimesh.creation.box((60, 2, 10)), 'too thin for a bead'),
        (trimesh.creation.box((20, 20, 300)), 'outside the machine'),
        (trimesh.creation.box((500, 20, 10)), '500.0 mm along x'),
    ],
)
def test_a_build_that_cannot_be_planned_is_refused_first(mesh, words, make_build):
    runner, cell = make_build(mesh)
    assert words in refused(runner, cell)
    assert runner.status.error_code == Code.PLAN_FAILED


def test_wire_of_a_build_is_checked_first(make_build):
    runner, cell = make_build(trimesh.creation.box((30, 20, 4)), wire_left=0.5)
    assert '0.5 m are on the spool' in refused(runner, cell)
    assert runner.status.error_code == Code.MACHINE_NOT_READY


def test_a_build_is_planned_once_and_laid(make_build, monkeypatch):
    from waam_job.run import planning

    plans, inner = [], planning.plan_build
    monkeypatch.setattr(planning, 'plan_build', lambda *a: plans.append(a) or inner(*a))
    runner, cell = make_build(
        trimesh.creation.box((30, 20, 4)), loop_mode='open_loop', wire_left=100.0
    )
    assert runner.run().state == State.DONE
    assert len(plans) == 1 and np.nanmax(cell.surface.z) > 2e-3


def test_a_restoration_too_large_for_the_machine_is_refused_first(make_cell, make_runner):
    cell = make_cell()
    cell.machine_state = replace(cell.machine_state, limit_max=(0.03, 0.3, 0.2))
    runner, _, _ = make_runner(cell, settings={'work_offset': (0.0, 0.0, 0.0)})
    said = refused(runner, cell)
    assert '40.0 mm along x' in said and 'cannot be scanned' in said


def test_more_authority_than_the_correction_server_allows_is_refused_first(make_cell, make_runner):
    cell = make_cell()
    cell.node_parameters = {'correction_server': {'k_gain_max': 0.3}}
    runner, _, _ = make_runner(cell, k_gain=0.4)
    assert 'k_gain is 0.4, the correction server allows 0.3' in refused(runner, cell)
    assert runner.status.error_code == Code.BAD_GOAL
    assert make_runner(make_cell(), k_gain=0.3)[0].run().state == State.DONE


def test_settings_of_the_planner_reach_the_plan(make_build):
    asked = ('levels=adaptive', 'overhang=flag', 'base_layers=0', 'lead_on=0.5')
    block = trimesh.creation.box((30, 20, 4))
    runner, _ = make_build(block, plan_settings=asked, loop_mode='open_loop')
    assert runner.run().state == State.DONE
    s = runner.context.plan.settings
    assert (s.levels, s.overhang, s.base_layers, s.lead_on) == ('adaptive', 'flag', 0, 0.5)
    assert 'overhang' in ' '.join(make_planned(make_build, mushroom(), ('overhang=flag',)).warnings)


def make_planned(make_build, mesh, asked):
    runner, _ = make_build(mesh, plan_settings=asked)
    assert runner.preflight.problems() == []
    return runner.preflight.plan


def test_a_mesh_with_a_hole_is_repaired_when_asked_and_the_report_says_so(make_build):
    block = trimesh.creation.box((30, 20, 4))
    torn = trimesh.Trimesh(block.vertices, block.faces[1:])
    runner, cell = make_build(torn, repair=True, loop_mode='open_loop')
    assert runner.run().state == State.DONE
    assert any('part repaired: hole of 3 edges' in r for r in runner.journal.remarks)


def test_faces_that_cross_are_told(make_build):
    both = trimesh.util.concatenate(
        [trimesh.creation.box((30, 20, 8)), trimesh.creation.box((20, 30, 6))]
    )
    runner, _ = make_build(both)
    assert any('self-intersection' in r for r in runner.preparation.remarks())


def test_a_machine_that_stands_half_a_step_beyond_its_limits_is_planned_from_within_them():
    """Homed, an axis is on a whole step; the top of its travel seldom is."""
    zero = (0.1, 0.08, 0.03)
    homed = Machine(
        position=(-0.1, -0.0800016, 0.1700019), limit_min=(0.0, 0.0, 0.0), limit_max=(0.4, 0.3, 0.2)
    )
    assert reached(homed, zero) == pytest.approx((-0.1, -0.08, 0.17), abs=1e-12)
    inside = replace(homed, position=(0.01, 0.02, 0.03))
    assert reached(inside, zero) == inside.position
    outside = replace(homed, position=(-0.1, -0.081, 0.1))
    assert reached(outside, zero) == outside.position, 'the planner names it'
    unknown = replace(homed, limit_max=(0.0, 0.0, 0.0))
    assert reached(unknown, zero) == homed.position
