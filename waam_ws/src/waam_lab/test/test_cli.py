"""`waam lab` as a user calls it: a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from waam_bringup.cli import main
from waam_lab.cli_campaign import parse_seeds

WAAM = [
    sys.executable,
    '-c',
    'import sys; from waam_bringup.cli import main; sys.exit(main())',
    'lab',
]


def lab(*arguments, **options) -> subprocess.CompletedProcess:
    command = [*WAAM, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def refused(capsys, *arguments) -> str:
    """What `waam lab` says when it refuses, in this process."""
    with pytest.raises(SystemExit) as ended:
        sys.exit(main(['lab', *map(str, arguments)]))
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_a_campaign_writes_its_report(parts, tmp_path):
    out = tmp_path / 'out'
    done = lab(
        parts[0],
        '--as-found',
        parts[1],
        '--seeds',
        '2,5',
        '--layers',
        1,
        '--out',
        out,
        '--keep-jobs',
    )
    assert done.returncode == 0, done.stderr
    assert 'RMS height error' in done.stdout
    assert '2/2 seed' in done.stderr
    report = json.loads((out / 'report.json').read_text())
    assert [job['seed'] for job in report['jobs']] == [2, 5]
    assert report['in_tolerance']['of'] == 2
    rms = [job['rms'] for job in report['jobs']]
    assert report['figures']['rms']['mean'] == pytest.approx(np.mean(rms))
    assert report['figures']['rms']['worst'] == max(rms)
    with np.load(out / 'maps.npz') as maps:
        assert maps['mean'].shape == maps['within'].shape == maps['region'].shape
        assert np.isfinite(maps['mean'][maps['region']]).mean() > 0.9
    page = (out / 'report.html').read_text()
    assert page.count('<img') == 3
    kept = sorted((out / 'jobs').glob('*_seed_*/report.json'))
    assert len(kept) == 2


@pytest.mark.parametrize(
    'arguments,words',
    [
        (['--seeds', 'many'], "--seeds 'many'"),
        (['--seeds', '5-2'], "--seeds '5-2'"),
        (['--seeds', '0'], "--seeds '0'"),
        (['--set', 'cell.metal_tranfer=1'], "did you mean 'metal_transfer'"),
        (['--set', 'correction_server.gain=7'], 'above its limit'),
        (['--set', 'plan.levls=2'], 'levls'),
        (['--material', 'unobtainium'], 'unobtainium'),
        (['--tolerance', '50'], 'tolerance is 50 mm'),
        (['--cell-file', 'gone.yaml'], 'gone.yaml'),
        (['--mode', 'build'], '--as-found'),
        (['--workers', '-2'], '--workers'),
        (['--urdf', 'arm.urdf'], '--urdf belongs to --machine robot'),
        (['--urdf', 'gone.urdf', '--machine', 'robot'], '--urdf gone.urdf: No such file'),
    ],
)
def test_bad_input_is_refused_before_anything_runs(parts, tmp_path, capsys, arguments, words):
    told = refused(capsys, parts[0], '--as-found', parts[1], '--out', tmp_path / 'out', *arguments)
    assert told.startswith('waam: error:')
    assert words in told
    assert not (tmp_path / 'out').exists()


def test_an_unknown_preset_is_refused_naming_the_three(parts, capsys):
    told = refused(capsys, parts[0], '--as-found', parts[1], '--preset', 'wild')
    assert "'wild'" in told and "known are gentle, recorded, rough" in told


def test_missing_files_are_named(parts, tmp_path, capsys):
    gone = tmp_path / 'gone.stl'
    for part, worn in ((gone, parts[1]), (parts[0], gone)):
        told = refused(capsys, part, '--as-found', worn, '--out', tmp_path / 'out')
        assert 'gone.stl: no such file' in told
    done = lab(parts[0], '--mode', 'restore', '--out', tmp_path / 'out')
    assert (done.returncode, '--as-found' in done.stderr) == (2, True)


def test_a_cell_file_changes_the_physics(parts, tmp_path):
    file, out = tmp_path / 'lean.yaml', tmp_path / 'out'
    file.write_text('cell:\n  ros__parameters:\n    scanner_dropout: 1.0\n')
    done = lab(parts[0], '--as-found', parts[1], '--seeds', 1, '--cell-file', file, '--out', out)
    assert done.returncode == 1
    assert 'seed 1 failed' in done.stdout
    report = json.loads((out / 'report.json').read_text())
    assert (report['failed'], report['jobs'][0]['verdict']) == (1, 'failed')
    assert 'no maps' in (out / 'report.html').read_text()
    file.write_text('bridge:\n  ros__parameters:\n    window: 500\n')
    assert (
        "must hold only 'cell'" in lab(parts[0], '--as-found', parts[1], '--cell-file', file).stderr
    )


def test_the_file_of_a_cell_says_machine_and_wire(parts, tmp_path):
    import argparse

    from waam_lab import cli, cli_campaign

    told = {
        'bridge': {'envelope_x': 2.0, 'max_speed_x': 0.1},
        'cell': {'work_zero': [1.0, 0.1, 0.02]},
    }
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(), lambda name: (told, '316l', f'cells/{name}.yaml'))
    words = ['lab', *map(str, (parts[0], '--as-found', parts[1])), '--cell', 'big']

    def job(*more):
        return cli_campaign.job_of(parser.parse_args([*words, *more]), tmp_path)[0]

    made = job('--set', 'bridge.max_speed_x=0.15', '--set', 'cell.metal_transfer=0.9')
    assert made.goal.material == '316l' and job('--material', 'er4043').goal.material == 'er4043'
    assert made.overrides['bridge'] == {'envelope_x': 2.0, 'max_speed_x': 0.15}
    assert made.overrides['cell'] == {'work_zero': [1.0, 0.1, 0.02], 'metal_transfer': 0.9}
    with pytest.raises(ValueError, match='--cell is the file of a gantry'):
        job('--machine', 'robot')


def test_ctrl_c_ends_everything(parts, tmp_path):
    command = [
        *WAAM,
        *map(str, (parts[0], '--as-found', parts[1], '--seeds', 500, '--out', tmp_path / 'out')),
    ]
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # whoever runs the tests in the background has SIGINT ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert '/500' in process.stderr.readline()
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    assert process.wait(20) == 130
    assert 'Traceback' not in process.stderr.read()
    end = time.monotonic() + 20
    while _alive(process.pid) and time.monotonic() < end:
        time.sleep(0.1)
    assert not _alive(process.pid)


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    'text,seeds',
    [('3', [1, 2, 3]), ('7,7,2-4', [7, 2, 3, 4]), ('11,', None), ('-3', None), ('99999', None)],
)
def test_seeds(text, seeds):
    if seeds is None:
        with pytest.raises(ValueError, match='--seeds'):
            parse_seeds(text)
    else:
        assert parse_seeds(text) == seeds


def test_programs_turn_the_part_as_the_job_does():
    from waam_lab.cli_robot_check import _cell
    from waam_lab.params import make
    from waam_plan.robot.cell import cell_of
    from waam_robot.station import Station

    turning, zero = (0.3, 1.5, -2.0), (0.1, 0.08, 0.02)
    robot = make({'robot_bridge': {'turning': turning}}).robot_bridge
    cell = cell_of(_cell(turning, robot, zero), 'cell.yaml')
    places = np.random.default_rng(4).uniform((0, 0, 0), (0.2, 0.15, 0.1), (20, 3))
    joints = Station(robot.place()).joints(places + zero)
    assert [cell.turn_at(tuple(p)) for p in places] == pytest.approx(joints[:, 7], abs=1e-9)
    assert np.array(cell.origin) == pytest.approx(np.add(robot.origin, zero))
    assert cell_of(_cell((0.0, 0.0, 0.0), robot, zero), 'x').positioner == 'hold'
