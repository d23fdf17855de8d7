"""Laboratory jobs spread over workers and machines: what is gained, and whether the figures stay the same.

fleet.efficiency: 40 short jobs (one layer, open loop) on two workers: time on one worker over twice the time on two,
start of the workers included (baseline: 1, nothing lost). The same on two local Ray nodes of one core each, where Ray
is installed, is printed beside it (its nodes are up, its workers are not);
fleet.identical: share of jobs whose every figure and last map are the same to the bit as on one worker: two workers,
four workers, two workers of which one is killed after the first result, two Ray nodes (baseline: 1, all of them).

WAAM_BENCH_FLEET_JOBS (40) shrinks the first.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from lib.emit import emit
from lib.preset import preset

JOBS = int(os.environ.get('WAAM_BENCH_FLEET_JOBS', '40'))


def short_jobs(folder: Path, count: int) -> list:
    from waam_lab import over_seeds, parts

    job = parts.job(folder, 'block', layers=1, loop_mode='open_loop', preset=preset())
    return over_seeds(job, list(range(1, count + 1)))


@contextmanager
def ray_nodes() -> Iterator[str]:
    """Address of two nodes on this machine; '' without Ray."""
    try:
        import ray
        from ray.cluster_utils import Cluster
    except ImportError:
        yield ''
        return
    memory = 200 << 20
    head = {'num_cpus': 1, 'object_store_memory': memory, 'include_dashboard': False}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    try:
        cluster.add_node(num_cpus=1, object_store_memory=memory)
        yield cluster.address
    finally:
        ray.shutdown()
        cluster.shutdown()


def timed(jobs: list, **how: Any) -> float:
    """s of wall time."""
    from waam_lab import run_many

    started = time.perf_counter()
    failed = [r.message for r in run_many(jobs, **how) if r.failed]
    if failed:
        raise RuntimeError(f'{len(failed)} jobs failed: {failed[0]}')
    return time.perf_counter() - started


def efficiency() -> None:
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch, ray_nodes() as address:
        jobs = short_jobs(Path(scratch), JOBS)
        timed(jobs[:1], workers=1)  # kernels are compiled
        one, two = (timed(jobs, workers=n) for n in (1, 2))
        on_ray = timed(jobs, cluster=address) if address else float('nan')
    said = f'{JOBS} jobs: one worker {one:.1f} s, two {two:.1f} s; two Ray nodes {on_ray:.1f} s'
    print(f'{said}, efficiency {one / (2 * on_ray):.3f}', file=sys.stderr)
    emit('fleet.efficiency', one / (2 * two), '', 'nothing lost', 1)


def same(a: Any, b: Any) -> bool:
    """Every figure and the map, to the bit; the processor time is no figure of the job."""
    names = (
        'seed',
        'verdict',
        'rms',
        'mean',
        'max_error',
        'rms_edges',
        'layer_means',
        'time',
        'wire',
        'bead_widths',
    )
    equal = all(repr(getattr(a, n)) == repr(getattr(b, n)) for n in names)
    return equal and np.array_equal(a.maps.error, b.maps.error, equal_nan=True)


def kill_one(told: list) -> None:
    """After the first result one worker is gone."""
    if len(told) == 1:
        multiprocessing.active_children()[0].kill()


def identical() -> None:
    from waam_lab import run_many

    shares = {}
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch, ray_nodes() as address:
        jobs = short_jobs(Path(scratch), 6)
        first = run_many(jobs, workers=1)
        told: list = []

        def lose(result: Any) -> None:
            told.append(result)
            kill_one(told)

        found = {
            'two workers': run_many(jobs, workers=2),
            'four workers': run_many(jobs, workers=4),
            'one killed': run_many(jobs, workers=2, done=lose),
        }
        if address:
            found['two Ray nodes'] = run_many(jobs, cluster=address)
        for name, results in found.items():
            shares[name] = sum(map(same, first, results)) / len(jobs)
            print(f'{name}: {shares[name]:.2f} of {len(jobs)} jobs the same', file=sys.stderr)
    emit('fleet.identical', min(shares.values()), 'share of jobs', 'all of them', 1)


FIGURES = {'fleet.efficiency': efficiency, 'fleet.identical': identical}
