"""Everything is killed in the middle of a bead; the graph is started again and the job goes on with what lies there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from waam_bringup.operate import graph_watch
from waam_bringup.test_support import power_cut, power_on
from waam_msgs.action import RunJob
from waam_node.testing import fresh_domain


def run_job(client, goal, run):
    return client.run_job(goal, lambda _: None, graph_watch(run))


@pytest.fixture(scope='module')
def undisturbed(tmp_path_factory, part, bench_class):
    """RMS (m) of the same job when nobody disturbs it."""
    folder, domain = tmp_path_factory.mktemp('whole'), fresh_domain()
    with power_on(folder / 'run', domain, 3) as (client, _):
        bench = bench_class(folder / 'run', folder / 'jobs', domain, client, part)
        result = bench.job()
    assert result.error_code == RunJob.Result.NONE, result.message
    return result.rms


def test_power_cut_in_a_bead_then_resume(tmp_path, part, undisturbed, background, bench_class):
    run, domain = tmp_path / 'run', fresh_domain()
    with power_on(run, domain, 3, 6.0) as (client, pids):
        bench = bench_class(run, tmp_path / 'jobs', domain, client, part)
        bench.load()
        background(bench)
        bench.wait(
            lambda: client.job and client.job.layer == 1 and client.job.bead >= 2, 90, 'bead 2'
        )
        power_cut(pids)
    folder = Path((run / 'job').read_text())
    before = json.loads((folder / 'checkpoint.json').read_text())
    assert before['layer'] == 1 and before['bead'] >= 1
    with power_on(run, domain, 3) as (client, _):
        result = run_job(client, RunJob.Goal(resume_dir=str(folder)), run)
        assert result.error_code == RunJob.Result.NONE, result.message
        again = run_job(client, RunJob.Goal(resume_dir=str(folder)), run)
        assert again.error_code == RunJob.Result.BAD_RESUME and 'finished' in again.message
    report = json.loads((folder / 'report.json').read_text())['closed_loop']
    resumed = [a['text'] for a in report['anomalies'] if 'resumed in layer 1' in a['text']]
    assert len(resumed) == 1 and 'segments are laid' in resumed[0]
    layers = [r['layer'] for r in report['layers'] if not r['final']]
    assert layers == list(range(1, result.layers + 1)) and report['runs'] == 2
    assert result.rms < 1.1 * undisturbed
    assert (folder / 'record').is_dir() and (folder / 'record_2').is_dir()
