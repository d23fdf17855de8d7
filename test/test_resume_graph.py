"""Everything is killed in the middle of a bead; the graph is started again and the job goes on with what lies there."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
from power import power_cut, power_on
from scipy.ndimage import median_filter

from waam_bringup.graph import Settings
from waam_bringup.operate import graph_watch
from waam_msgs.action import RunJob
from waam_node.testing import fresh_domain
from waam_sim.table import restore

RIM = 3e-3  # m from the edge of the part, where its surface ends in a step


def run_job(client, goal, run):
    return client.run_job(goal, lambda _: None, graph_watch(run))


def as_planned(folder: Path, copy: Path) -> Path:
    """A copy of a job that was planned and of which nothing is laid. A new job would have another plan: the scan that
    it is made of is never the same twice, and a bead more or less in a corner changes the RMS by a tenth."""
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns('record*', 'checkpoint*', 'track'))
    return copy


def tallest_needle(run: Path) -> float:
    """Height (m) by which a point of the true surface of the part stands over the surface around it."""
    table = restore(run / 'table.npy')
    x, y = np.meshgrid(table.spec.x, table.spec.y)
    part = (np.abs(x - 18e-3) < 18e-3 - RIM) & (np.abs(y - 15e-3) < 15e-3 - RIM)
    return float((table.z - median_filter(table.z, 5))[part].max())


def test_power_cut_in_a_bead_then_resume(tmp_path, part, background, bench_class):
    run, domain = tmp_path / 'run', fresh_domain()
    settings = Settings(run=run, seed=3, without=('dashboard', 'panel'), preset='gentle')
    with power_on(replace(settings, rate=6.0), domain) as (client, pids):
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
    undisturbed = as_planned(folder, tmp_path / 'jobs' / 'undisturbed')
    with power_on(settings, domain) as (client, _):
        result = run_job(client, RunJob.Goal(resume_dir=str(folder)), run)
        assert result.error_code == RunJob.Result.NONE, result.message
        needle = tallest_needle(run)
        again = run_job(client, RunJob.Goal(resume_dir=str(folder)), run)
        assert again.error_code == RunJob.Result.BAD_RESUME and 'finished' in again.message
        bench_class(run, tmp_path / 'jobs', domain, client, part).load()
        whole = run_job(client, RunJob.Goal(resume_dir=str(undisturbed)), run)
        assert whole.error_code == RunJob.Result.NONE, whole.message
    report = json.loads((undisturbed / 'report.json').read_text())['closed_loop']
    assert any('nothing of it is laid' in a['text'] for a in report['anomalies'])
    report = json.loads((folder / 'report.json').read_text())['closed_loop']
    resumed = [a['text'] for a in report['anomalies'] if 'resumed in layer 1' in a['text']]
    assert len(resumed) == 1 and 'segments are laid' in resumed[0]
    layers = [r['layer'] for r in report['layers'] if not r['final']]
    assert layers == list(range(1, result.layers + 1)) and report['runs'] == 2
    assert (folder / 'record').is_dir() and (folder / 'record_2').is_dir()
    assert not any('plan unlike the training' in a['text'] for a in report['anomalies'])
    assert needle < 1e-3, 'no metal was lost or heaped up at the cut or behind it'
    assert result.max_error < 1.5 * whole.max_error
    assert result.rms < 1.1 * whole.rms
