"""A recorded job computed again, offline and by the nodes in lock-step.

replay.speed: machine seconds of the record per second of reading and computing (baseline: what is asked for);
replay.identical: share of maps, psi and sets of setpoints that equal the record to the last bit, 0 when two runs differ
from each other (baseline: all);
replay.lockstep_identical: the same for the nodes on a graph of their own.

BENCH_REPLAY_JOB: folder of a recorded job; without it two layers of the demo part are laid first (one
minute).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

from emit import emit
from limit import within

NAMES = ['replay.speed', 'replay.identical', 'replay.lockstep_identical']


JOB_S, LOCKSTEP_S, OFFLINE_S = 600.0, 180.0, 300.0  # the longest wait for each part, wall time


def make_job(scratch: Path) -> Path:
    from waam_bringup.demo import run_demo

    args = SimpleNamespace(seed=7, jobs=scratch, layers=2, profiles=['closed_loop'], rate=0.0)
    stdout, sys.stdout = sys.stdout, sys.stderr
    try:
        with within(JOB_S, 'the job that is recorded'):
            run_demo(args)
    finally:
        sys.stdout = stdout
    return next((scratch / 'latest').resolve().glob('*/record')).parent


def measure(job: Path) -> None:
    from waam_replay.tune import tune

    with within(OFFLINE_S, 'computing offline'):
        tune(job)  # compiles what is not cached
        runs = [tune(job) for _ in range(3)]
    best = min(runs, key=lambda r: r.seconds)
    emit('replay.speed', best.machine_seconds / best.seconds, 's/s', 'asked for', 100.0)
    same = len({r.digest for r in runs}) == 1
    found = sum(n for n, _ in best.identical.values())
    total = sum(t for _, t in best.identical.values())
    emit('replay.identical', found / total if same else 0.0, '1', f'all {total} of the record', 1.0)
    command = [sys.executable, '-m', 'waam_bringup.cli', 'replay', 'play', str(job), '--lockstep']
    done = subprocess.run(
        command, stdout=subprocess.PIPE, text=True, check=False, timeout=LOCKSTEP_S
    )
    print(done.stdout, file=sys.stderr)
    rows = [line.split() for line in done.stdout.splitlines() if line.endswith('identical')]
    good, asked = (sum(int(row[i]) for row in rows) for i in (1, 3))
    emit('replay.lockstep_identical', good / asked if asked else 0.0, '1', f'all {asked}', 1.0)


def main() -> None:
    if given := os.environ.get('BENCH_REPLAY_JOB'):
        measure(Path(given))
        return
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        measure(make_job(Path(scratch)))


if __name__ == '__main__':
    main()
