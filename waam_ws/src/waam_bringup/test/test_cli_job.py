"""The command line of jobs: what it promises is what is there, and what it is told reaches the goal."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
import trimesh

from waam_bringup import cli_job, demo, jobs
from waam_bringup.cli import build_parser
from waam_job.model.limits import K_GAIN_MAX
from waam_plan.mesh.part import FORMATS


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


def test_the_recording_of_a_plan_is_drawn_by_the_viewer(tmp_path):
    import trimesh

    trimesh.creation.box((30, 20, 4)).export(tmp_path / 'box.stl')
    words = ['plan', str(tmp_path / 'box.stl'), '--rerun', '--out', str(tmp_path / 'out')]
    args = build_parser().parse_args(words)
    assert args.run_command(args) == 0
    assert (tmp_path / 'out' / 'preview.rrd').read_bytes()[:4] == b'RRF2'
