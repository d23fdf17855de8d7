"""A recorded job computed again.

replay.speed: machine seconds of the record per second of reading and computing (baseline: what is asked for);
replay.identical: share of maps, psi and sets of setpoints that equal the record to the last bit, 0 when two runs differ
from each other (baseline: all).

BENCH_REPLAY_JOB: folder of a recorded job; without it two layers of the demo part are laid first (one
minute).
"""

from __future__ import annotations

import atexit
import os
import tempfile
from functools import cache
from pathlib import Path

from lib.demo import demo
from lib.emit import emit
from lib.limit import within
from lib.preset import preset

JOB_S, OFFLINE_S = 600.0, 300.0  # the longest wait for each part, wall time


@cache
def recorded_job() -> Path:
    """The job that BENCH_REPLAY_JOB names, or one that is made now: once for all figures of a run."""
    from waam_node import job_folder

    if given := os.environ.get('BENCH_REPLAY_JOB'):
        return Path(given)
    scratch = tempfile.TemporaryDirectory(prefix='waam_bench_')
    atexit.register(scratch.cleanup)
    jobs = Path(scratch.name)
    with within(JOB_S, 'the job that is recorded'):
        demo(jobs, 7, ('closed_loop',), preset(), layers=2)
    return next((jobs / job_folder.LATEST).resolve().glob(f'*/{job_folder.record()}')).parent


def offline() -> None:
    from waam_replay.tune import tune

    job = recorded_job()
    with within(OFFLINE_S, 'computing offline'):
        tune(job)  # compiles what is not cached
        runs = [tune(job) for _ in range(3)]
    best = min(runs, key=lambda r: r.seconds)
    emit('replay.speed', best.machine_seconds / best.seconds, 's/s', 'asked for', 100.0)
    same = len({r.digest for r in runs}) == 1
    found = sum(n for n, _ in best.identical.values())
    total = sum(t for _, t in best.identical.values())
    emit('replay.identical', found / total if same else 0.0, '1', f'all {total} of the record', 1.0)


FIGURES = {
    'replay.speed': offline,
    'replay.identical': offline,
}
