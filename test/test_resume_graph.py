"""Everything is killed in the middle of a bead; the graph is started again and the job goes on with what lies there."""

from __future__ import annotations

import json
import os
import signal
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from waam_bringup import run_state
from waam_bringup.client import GraphClient
from waam_bringup.graph import Settings
from waam_bringup.operate import graph_trouble, stop, up
from waam_msgs.action import RunJob

DOMAIN = 221


@contextmanager
def power_on(run: Path, domain: int, rate: float):
    """The graph, to be killed or stopped; nothing of it is left afterwards."""
    args = ['--run', str(run), '--domain', str(domain), '--seed', '3', '--rate', str(rate)]
    state = up(Settings(run=run, seed=3, rate=rate), domain, 90.0, args)
    pids = [state.supervisor, *(n.pid for n in state.nodes.values())]
    try:
        with GraphClient(domain) as client:
            yield client, pids
    finally:
        if run_state.process_exists(state.supervisor):
            stop(run)


def power_cut(pids: list[int]) -> None:
    """kill -9 of the whole graph, the supervisor first so that it can tidy nothing up."""
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    end = time.monotonic() + 20
    while any(map(run_state.process_exists, pids)) and time.monotonic() < end:
        time.sleep(0.05)
        for pid in pids:
            try:
                os.waitpid(pid, os.WNOHANG)
            except ChildProcessError:
                continue


def run_job(client, goal, run):
    return client.run_job(goal, lambda _: None, lambda: graph_trouble(run))


@pytest.fixture(scope='module')
def undisturbed(tmp_path_factory, part, bench_class):
    """RMS (m) of the same job when nobody disturbs it."""
    folder = tmp_path_factory.mktemp('whole')
    with power_on(folder / 'run', DOMAIN, 0.0) as (client, _):
        bench = bench_class(folder / 'run', folder / 'jobs', DOMAIN, client, part)
        result = bench.job()
    assert result.error_code == RunJob.Result.NONE, result.message
    return result.rms


def test_power_cut_in_a_bead_then_resume(tmp_path, part, undisturbed, background, bench_class):
    run = tmp_path / 'run'
    with power_on(run, DOMAIN + 1, 6.0) as (client, pids):
        bench = bench_class(run, tmp_path / 'jobs', DOMAIN + 1, client, part)
        bench.load()
        background(bench)
        bench.wait(
            lambda: client.job and client.job.layer == 1 and client.job.bead >= 2, 90, 'bead 2'
        )
        power_cut(pids)
    folder = Path((run / 'job').read_text())
    before = json.loads((folder / 'checkpoint.json').read_text())
    assert before['layer'] == 1 and before['bead'] >= 1
    with power_on(run, DOMAIN + 1, 0.0) as (client, _):
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
