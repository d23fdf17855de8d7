"""The command line starts without what only some verbs need."""

from __future__ import annotations

import subprocess
import sys
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

HEAVY = {'numpy', 'scipy', 'numba', 'trimesh', 'torch', 'open3d', 'rclpy', 'rerun'}


def loaded_after(statement: str) -> set[str]:
    """Names of the modules that a fresh interpreter has loaded after a statement."""
    code = f'{statement}\nimport sys\nprint(" ".join(sys.modules))'
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return set(ran.stdout.split())


def test_the_parser_of_all_verbs_loads_no_heavy_library():
    loaded = loaded_after('from waam_bringup.cli import build_parser; build_parser()')
    assert 'waam_lab.cli' in loaded and not loaded & HEAVY


def test_nodes_that_identify_nothing_start_without_scipy():
    for node in ('thermal_compensator', 'feed_forward', 'process_control'):
        assert 'scipy' not in loaded_after(f'import waam_adapt.{node}_node'), node


def test_a_reader_that_goes_is_no_error():
    code = """
import argparse, sys
from waam_bringup import audited, cli
parser = argparse.ArgumentParser()
parser.set_defaults(command='talk', run_command=lambda args: print('x' * 2000000))
cli.build_parser = lambda: parser
sys.exit(cli.main([]))
"""
    ran = subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    ran.stdout.read(1)
    ran.stdout.close()
    assert ran.stderr.read() == ''
    assert ran.wait() == 141


def test_the_demo_takes_parameter_files_and_refuses_missing_ones(tmp_path, capsys, monkeypatch):
    from waam_bringup import demo
    from waam_bringup.cli import main

    given = []
    monkeypatch.setattr(demo, 'run_demo', lambda args, files: given.extend(files) or 0)
    file = tmp_path / 'nodes.yaml'
    file.write_text('{}')
    assert main(['demo', '--params-file', str(file)]) == 0 and given == [file]
    assert main(['demo', '--params-file', str(tmp_path / 'none.yaml')]) == 2
    assert 'none.yaml: no such file' in capsys.readouterr().err


def test_a_graph_of_a_program_is_started_with_all_of_its_settings(tmp_path):
    """The demo on the robot ran on the gantry: the machine was not among what the supervisor is told."""
    from dataclasses import fields

    from waam_bringup.cli import build_parser
    from waam_bringup.cli_graph import settings_of
    from waam_bringup.graph import Settings
    from waam_bringup.operate import arguments

    file = tmp_path / 'nodes.yaml'
    file.write_text('bridge: {ros__parameters: {}}\n')
    wanted = Settings(
        run=tmp_path,
        port='/dev/ttyACM7',
        pyrometer='serial:/dev/ttyUSB3',
        rate=3.0,
        seed=5,
        machine_steps=(321.6, 320.0, 400.25),
        grpc_port=9911,
        web_port=9912,
        panel_port=9913,
        stop_port=9920,
        hang_timeout=7.0,
        params_files=(file,),
        without=('panel', 'dashboard'),
        machine='robot',
        preset='rough',
    )
    default = Settings(run=tmp_path / 'other')
    told = settings_of(build_parser().parse_args(['up', *arguments(wanted, 42)]), tmp_path)
    for field in fields(Settings):
        if field.name not in (
            'epoch_us',
            'namespace',
        ):  # the time of the start; what only launch sets
            assert getattr(told, field.name) == getattr(wanted, field.name), field.name
            assert getattr(wanted, field.name) != getattr(default, field.name), field.name


@pytest.fixture
def robot_demo(tmp_path, monkeypatch):
    """A function that runs a demo on a robot whose jobs all end with this error: its exit status, the jobs begun."""
    from waam_bringup import demo
    from waam_bringup.cli import main
    from waam_msgs.action import RunJob
    from waam_view import report

    def run(code: int, message: str = '') -> tuple[int, list[str]]:
        begun: list[str] = []

        def run_job(goal, *_):
            begun.append(goal.name)
            folder = str(tmp_path / goal.name)
            return RunJob.Result(job_dir=folder, error_code=code, message=message)

        client = SimpleNamespace(machine=None, load_part=lambda *_: None, run_job=run_job)
        monkeypatch.setattr(demo, 'graph', lambda *_: nullcontext((None, client)))
        monkeypatch.setattr(report, 'write_report', lambda folder: folder / 'report.html')
        return main(['demo', '--machine', 'robot', '--jobs', str(tmp_path)]), begun

    return run


def test_a_demo_whose_job_is_aborted_does_not_begin_the_next_one(robot_demo, capsys):
    from waam_msgs.action import RunJob

    assert robot_demo(RunJob.Result.ABORTED) == (130, ['open_loop'])
    assert 'aborted; report: ' in capsys.readouterr().err


def test_a_demo_whose_cell_dies_says_so_and_ends(robot_demo, capsys, monkeypatch):
    monkeypatch.setattr('waam_bringup.demo.ended', lambda run: ['cell killed by SIGKILL'])
    status, begun = robot_demo(110, 'robot: the welding device is silent for 3.02 s')
    assert status != 0 and begun == ['open_loop']
    said = capsys.readouterr().err
    assert 'open_loop: error 110: robot: the welding device is silent' in said
    assert 'cell killed by SIGKILL' in said and 'closed_loop' not in said
