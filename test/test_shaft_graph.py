"""A worn shaft through real processes: a chuck in place of the X axis, turned by the controller as it is unrolled."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from power import power_cut, power_on

from waam_bringup import demo_shaft
from waam_bringup.cli_job import add_run_options
from waam_bringup.client import ClientError
from waam_bringup.graph import Settings
from waam_bringup.jobs import checked_of, make_goal, place_part
from waam_bringup.operate import graph_watch
from waam_lab import restore_shaft, run
from waam_lab.shafts import WornShaft
from waam_msgs.action import RunJob
from waam_msgs.msg import JobStatus
from waam_msgs.srv import Command
from waam_node.testing import fresh_domain
from waam_process.operating import CHUCK_STEPS
from waam_process.unrolled import OVERLAP, Unrolled

WORN = WornShaft(0.040, 0.046, 0.012, 'oval', 1.4e-3, run_out=(0.3e-3, -0.15e-3), turned=2.0)
HELIX = replace(WORN, wear='scored', depth=1.1e-3)  # one layer, a helix of six turns
SHAFT, SEED = Unrolled(WORN.diameter), 3


def load(client, file: Path) -> argparse.Namespace:
    """Clamps the worn shaft; the arguments of its job."""
    options = argparse.ArgumentParser()
    add_run_options(options)
    asked = options.parse_args([*demo_shaft.words(file, WORN), '--fresh', '--operator', 'test'])
    place_part(client, asked, checked_of(asked), SEED)
    return asked


@pytest.fixture(scope='module')
def graph(tmp_path_factory, graph_in, part):
    """A cell with a chuck, and the scan of a worn shaft."""
    folder = tmp_path_factory.mktemp('shaft')
    file = demo_shaft.write(folder, WORN)
    with graph_in(folder, part, params_files=(demo_shaft.chuck_params(folder),)) as bench:
        yield bench, file


@pytest.fixture(scope='module')
def done(graph):
    """The folder of a closed-loop job."""
    bench, file = graph
    asked = load(bench.client, file)
    result = bench.run_job(make_goal(asked, bench.jobs))
    assert result.error_code == 0, result.message
    return Path(result.job_dir)


def run_of(folder: Path) -> dict:
    return json.loads((folder / 'report.json').read_text())['closed_loop']


def test_the_shaft_is_round_again_and_its_run_out_was_taken_out(done):
    report = run_of(done)
    shaft = report['shaft']
    assert report['rms_mm'] < 0.3 * report['as_found_rms_mm']
    assert np.allclose(shaft['axis_mm'], np.array(WORN.run_out) * 1e3, atol=0.03)
    assert 0.0 < shaft['roundness_mm'] < 0.9 and 0.0 < shaft['new_run_out_mm'] < 0.3
    assert abs(shaft['seam_step_mm']) < 0.2
    assert shaft['clean_diameter_mm'] < WORN.diameter * 1e3 + 0.2
    assert 'turned to' in report['message']


def test_the_controller_turned_it_by_the_steps_of_its_diameter(graph, done):
    bench, _ = graph
    told = bench.client.call(
        Command, 'bridge/command', Command.Request(code=Command.Request.SETTINGS)
    )
    settings = dict(word.split('=') for word in told.message.split() if '=' in word)
    wanted = CHUCK_STEPS / (SHAFT.period * 1e3)
    assert float(settings['steps_per_mm_x']) == pytest.approx(wanted, abs=1e-3)
    x = np.load(done / 'telemetry.npz')['x']
    assert x.max() > OVERLAP + 2 * SHAFT.period, 'a helix goes several times around'


def test_offline_replay_gives_every_map_correction_and_setpoint_again(done):
    from waam_replay.tune import tune

    layers = len([r for r in run_of(done)['layers'] if not r['final']])
    scans = len(list((done / 'layers').glob('*.npz')))
    assert tune(done).identical == {
        'maps': (scans, scans),
        'psi': (layers, layers),
        'setpoints': (layers, layers),
    }


def test_the_laboratory_foretells_it(graph, done, tmp_path):
    _, file = graph
    report = run_of(done)
    lab = run(
        restore_shaft(file, WORN.diameter, WORN.ends, SEED, preset='gentle', jobs_dir=tmp_path)
    )
    assert lab.layers == len([r for r in report['layers'] if not r['final']])
    assert lab.wire == pytest.approx(report['wire_m'], rel=0.05)
    assert lab.rms * 1e3 == pytest.approx(report['rms_mm'], rel=0.25)


def test_a_part_that_lies_still_is_refused(graph, done):
    bench, _ = graph
    with pytest.raises(ClientError, match='the X axis of this cell is a chuck'):
        bench.load()
    result = bench.run_job(bench.goal())
    assert result.error_code == RunJob.Result.BAD_GOAL
    assert 'the X axis of this cell is a chuck' in result.message


def in_bead(client, bead: int) -> bool:
    return bool(client.job and client.job.layer == 1 and client.job.bead >= bead)


def test_pause_and_power_cut_in_a_helix_then_resume(tmp_path, background, bench_class, part):
    domain, graph_folder = fresh_domain(), tmp_path / 'run'
    settings = Settings(
        run=graph_folder, seed=SEED, without=('dashboard', 'panel'), preset='gentle',
        params_files=(demo_shaft.chuck_params(tmp_path),),
    )  # fmt: skip
    file = demo_shaft.write(tmp_path, HELIX)
    with power_on(replace(settings, rate=6.0), domain) as (client, pids):
        bench = bench_class(graph_folder, tmp_path / 'jobs', domain, client, part)
        goal = make_goal(load(client, file), bench.jobs)
        bench.goal = lambda: goal
        background(bench)
        bench.wait(lambda: in_bead(client, 2), 90, 'bead 2')
        client.trigger('job_sequencer/pause')
        bench.wait(lambda: client.job.state == JobStatus.PAUSED, 30, 'the pause')
        client.trigger('job_sequencer/resume')
        bench.wait(lambda: in_bead(client, 4), 90, 'bead 4')
        power_cut(pids)
    folder = Path((graph_folder / 'job').read_text())
    assert json.loads((folder / 'checkpoint.json').read_text())['laid'] > 120, 'in the third turn'
    with power_on(settings, domain) as (client, _):
        goal = RunJob.Goal(resume_dir=str(folder))
        result = client.run_job(goal, lambda _: None, graph_watch(graph_folder))
    assert result.error_code == RunJob.Result.NONE, result.message
    report = run_of(folder)
    said = [a['text'] for a in report['anomalies']]
    (resumed,) = [text for text in said if 'resumed in layer 1' in text]
    assert 'segments are laid, on from bead' in resumed
    assert any('hardly shows a shift along' in text for text in said), 'worn alike all round'
    assert report['runs'] == 2 and report['rms_mm'] < 0.35 * report['as_found_rms_mm']
    assert abs(report['shaft']['seam_step_mm']) < 0.3
