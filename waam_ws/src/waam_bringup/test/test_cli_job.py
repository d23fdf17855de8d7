"""The command line of jobs: what it promises is what is there, and what it is told reaches the goal."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest
import trimesh

from waam_bringup import cli_job, demo, jobs
from waam_bringup.run_state import RunState
from waam_job.conversions import goal_from_msg
from waam_job.model.goal import JobError, check
from waam_job.model.limits import K_GAIN_MAX
from waam_job.ros.node_requests import new_folder, recheck, reopen
from waam_msgs.action import RunJob
from waam_node import job_folder
from waam_plan.mesh.part import FORMATS
from waam_process.grid import HeightGrid


@pytest.fixture
def parse():
    parser = argparse.ArgumentParser()
    cli_job.register_job(parser.add_subparsers())
    return lambda *words: parser.parse_args(['job', *map(str, words)])


def help_of(parse, capsys, *words) -> str:
    with pytest.raises(SystemExit):
        parse(*words, '--help')
    return ' '.join(capsys.readouterr().out.split())


def test_help_names_every_kind_of_mesh_and_the_limit_of_the_gain(parse, capsys):
    text = help_of(parse, capsys, 'run')
    for kind in FORMATS:
        assert kind[1:].upper() in text
    assert f'0..{K_GAIN_MAX:g}' in text
    assert f'0..{K_GAIN_MAX:g}' in help_of(parse, capsys, 'gain')


@pytest.fixture
def box(tmp_path) -> Path:
    file = tmp_path / 'box.stl'
    trimesh.creation.box(extents=(30, 20, 10)).export(file)
    return file


def test_settings_and_repair_reach_the_goal(parse, box, tmp_path):
    args = parse('run', box, '--set', 'levels=adaptive', '--set', 'lead_on=0.5', '--repair')
    jobs.check_arguments(args)
    goal = jobs.make_goal(args, tmp_path)
    assert list(goal.plan_settings) == ['levels=adaptive', 'lead_on=0.5'] and goal.repair
    plain = jobs.make_goal(parse('run', box), tmp_path)
    assert not plain.plan_settings and not plain.repair


def test_a_build_gets_a_plate_that_is_large_enough(parse, tmp_path):
    file, loaded = tmp_path / 'bar.stl', []
    trimesh.creation.box(extents=(260, 20, 10)).export(file)
    client = Mock(running_job=lambda: None, load_part=lambda *asked: loaded.append(asked))
    args = parse('run', file, '--mode', 'build')
    jobs.place_part(client, args, jobs.check_arguments(args))
    ((mesh, plate, seed),) = loaded
    assert mesh == '' and seed == -1
    assert plate == pytest.approx((0.300, 0.200, 0.010))


def test_a_worn_part_is_put_where_the_program_expects_it(parse, tmp_path):
    """In the nominal part's coordinates and units; the worn box has lost its end at low x, and with it its corner."""
    files, loaded = (tmp_path / 'nominal.stl', tmp_path / 'worn.stl'), []
    for file, length, height in zip(files, (0.060, 0.050), (0.020, 0.016), strict=True):
        box = trimesh.creation.box(extents=(length, 0.030, height))
        box.apply_translation(
            (0.5 - length / 2, 0.1, height / 2 + 0.3)
        )  # m; the same end at high x
        box.export(file)

    def load(path, plate, seed):
        loaded.append(HeightGrid.load_npz(path))

    client = Mock(running_job=lambda: None, load_part=load)
    args = parse('run', files[0], '--as-found', files[1], '--scale', '1')
    jobs.place_part(client, args, jobs.check_arguments(args))
    (lies,) = loaded
    assert lies.sample(0.030, 0.015) == pytest.approx(0.016, abs=1e-6)
    assert lies.sample(0.0595, 0.015) == pytest.approx(0.016, abs=1e-6)
    assert lies.sample(0.0625, 0.015) == lies.sample(-0.002, 0.015) == 0.0
    box.apply_translation((0, 0, -0.020))
    box.export(files[1])
    with pytest.raises(ValueError, match='wholly below the part'):
        jobs.place_part(client, args, jobs.check_arguments(args))


def test_wire_lot_and_gas_are_notes_of_the_job(parse, box, tmp_path):
    args = parse('run', box, '--wire-lot', 'L7', '--gas', 'M21', '--note', 'shift=2')
    assert list(jobs.make_goal(args, tmp_path).notes) == ['shift=2', 'wire_lot=L7', 'gas=M21']


def test_a_job_notes_the_preset_of_a_simulated_cell():
    state = RunState(1, 'up', 7, True, 'port')
    assert jobs.cell_notes(replace(state, preset='rough')) == ['preset=rough']
    assert jobs.cell_notes(state) == []  # a real cell


def test_fresh_and_the_folder_of_what_was_learned_reach_the_goal(parse, box, tmp_path):
    plain = jobs.make_goal(parse('run', box), tmp_path)
    assert not plain.fresh and plain.learned_dir == ''
    fresh = jobs.make_goal(parse('run', box, '--fresh'), tmp_path, tmp_path / 'learned')
    assert fresh.fresh and fresh.learned_dir == str(tmp_path / 'learned')


@pytest.mark.parametrize(
    ('learned', 'said'),
    [({}, 'nothing'), ({'jobs': 0}, 'started fresh'), ({'jobs': 1}, '1 former job of'), ({'jobs': 2}, '2 former jobs')],
)  # fmt: skip
def test_the_demo_says_what_it_started_with(learned, said):
    assert said in demo.start_of({'learned': learned})


def test_bad_settings_are_refused_without_a_graph_and_all_at_once(parse, box):
    args = parse('run', box, '--set', 'nonsense=1', '--set', 'cusp=deep', '--k-gain', 0.9)
    with pytest.raises(
        ValueError, match=r'(?s)k_gain is 0.9.*no setting nonsense.*is not a float.*known: '
    ):
        jobs.check_arguments(args)


def test_a_new_spool_is_told_when_a_job_goes_on(parse):
    assert parse('resume', '--wire-left', 120).wire_left == 120.0
    assert parse('resume').wire_left == 0.0


@pytest.fixture
def program(tmp_path) -> Path:
    file = tmp_path / 'wall.gcode'
    file.write_text('G0 Z9\nG0 X0 Y0\nG1 Z0 F600\nW5000 S22\nM3\nG1 X40 F600\nM5\n')
    return file


def test_a_program_reaches_the_goal_and_comes_back(parse, program, box, tmp_path):
    args = parse('run', program, '--nominal', box, '--shift', 10, 5, -2, '--dialect', 'welder')
    sent = jobs.make_goal(args, tmp_path)
    goal = goal_from_msg(sent, 'jobs')
    assert (goal.program, goal.part, goal.dialect) == (program, box, 'welder')
    assert goal.program_shift == pytest.approx((0.01, 0.005, -0.002))
    assert (goal.mode, goal.loop_mode) == ('build', 'closed_loop')
    assert goal.title == 'wall'


def test_a_program_without_a_nominal_part_is_watched(parse, program, tmp_path):
    args = parse('run', program)
    jobs.check_arguments(args)
    goal = goal_from_msg(jobs.make_goal(args, tmp_path), 'jobs')
    assert (goal.loop_mode, goal.has_part, goal.mode) == ('monitor', False, 'build')
    with pytest.raises(ValueError, match='closed_loop needs a nominal part'):
        jobs.check_arguments(parse('run', program, '--loop-mode', 'closed_loop'))
    program.write_text('G77')
    with pytest.raises(ValueError, match='line 1: G77'):
        jobs.check_arguments(args)


def test_options_of_a_program_are_refused_for_a_part(parse, box):
    for option in (('--nominal', box), ('--dialect', 'waam'), ('--shift', 1, 0, 0)):
        with pytest.raises(ValueError, match='belong to a program'):
            jobs.check_arguments(parse('run', box, *option))


def test_a_job_goes_on_with_its_own_copy_of_the_program(parse, program, tmp_path):
    sent = jobs.make_goal(parse('run', program), tmp_path / 'jobs')
    goal = goal_from_msg(sent, 'jobs')
    folder = new_folder(goal, check(goal), {})
    program.unlink()
    resumed, found = reopen(RunJob.Goal(resume_dir=str(folder.path)))
    assert found.program == folder.path / job_folder.PROGRAM_GIVEN
    assert recheck(found, resumed).program is not None
    found.program.write_text(found.program.read_text().replace('X40', 'X41'))
    with pytest.raises(JobError, match='was changed since the job began'):
        recheck(found, resumed)


@pytest.mark.parametrize('ignored', [False, True])
def test_an_interrupted_job_goes_on_only_with_what_was_calibrated(
    parse, tmp_path, monkeypatch, ignored
):
    """A loss of power interrupts the job and takes the controller's settings along."""
    (tmp_path / job_folder.JOB).write_text('{}')
    monkeypatch.setattr(jobs, 'require_up', lambda run: None)
    monkeypatch.setattr(jobs, 'run_and_domain', lambda args: (tmp_path, 0))
    monkeypatch.setattr(jobs.calibrate, 'check', lambda args: ['steps_x: the controller has 320'])
    reached = RuntimeError('the graph is asked')

    def client(domain):
        raise reached

    monkeypatch.setattr(jobs, 'GraphClient', client)
    args = parse('resume', tmp_path, *(['--ignore-calibration'] if ignored else []))
    with pytest.raises((ValueError, RuntimeError)) as e:
        jobs.go_on(args)
    assert (e.value is reached) if ignored else 'steps_x: the controller has 320' in str(e.value)
