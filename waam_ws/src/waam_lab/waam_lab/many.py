"""Many jobs on all cores, or on a Ray cluster. Results come in the order of the jobs and are the same, whatever the
number of workers and machines.

A worker that is lost costs the jobs that were under way, which are done again; on a cluster its own job only.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from .job import LabJob, LabResult
from .laboratory import failed, run
from .pieces import Pieces

ONE_THREAD = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
TRIES = 3  # pools that may break one after the other without a result
Found = Iterator[tuple[int, LabResult]]  # index of the job and its result, as they come


def run_many(
    jobs: Sequence[LabJob],
    workers: int = 0,
    done: Callable[[LabResult], None] | None = None,
    cluster: str = '',
    pieces: Pieces | None = None,
) -> list[LabResult]:
    """One result per job. workers: 0 = one per core; done: called with every result as it comes.

    cluster: address of a Ray cluster ('auto', HOST:PORT, ray://HOST:PORT) that does the work instead; ClusterError when
    there is none. pieces: where results are kept as they come; jobs that it has are not run again.
    A job that is refused or that a fault of this software ends gives a result with verdict 'failed'.
    """
    found: dict[int, LabResult] = {}

    def take(i: int, result: LabResult) -> None:
        found[i] = result
        if done:
            done(result)

    for i, job in enumerate(jobs):
        kept = pieces.read(job) if pieces else None
        if kept is not None:
            take(i, kept)
    waiting = {i: job for i, job in enumerate(jobs) if i not in found}
    for i, result in _results(waiting, workers, cluster):
        if pieces and not result.failed:
            pieces.write(waiting[i], result)
        take(i, result)
    return [found[i] for i in range(len(jobs))]


def workers_for(asked: int, jobs: int) -> int:
    """Processes that are worth it; asked: 0 = one per core."""
    return min(asked or os.cpu_count() or 1, max(1, jobs))


def attempt(job: LabJob) -> LabResult:
    """One job in a worker; whatever ends it is a result."""
    try:
        return run(job)
    except Exception as e:
        return failed(job, e)


def _results(waiting: dict[int, LabJob], workers: int, cluster: str) -> Found:
    if not waiting:
        return
    if cluster:
        from .ray_cluster import results

        yield from results(waiting, cluster, attempt, ONE_THREAD)
        return
    left, breaks = dict(waiting), 0
    while left:
        try:
            for i, result in _pool(left, workers_for(workers, len(left))):
                del left[i]
                breaks = 0
                yield i, result
        except BrokenProcessPool as e:
            breaks += 1
            if breaks == TRIES:
                yield from ((i, failed(job, e)) for i, job in left.items())
                return


def _pool(jobs: dict[int, LabJob], workers: int) -> Found:
    """Raises BrokenProcessPool when a worker was killed; what came before has been told."""
    with _one_thread_each():
        pool = ProcessPoolExecutor(workers, _context(), _start)
        try:
            tasks = {pool.submit(attempt, job): i for i, job in jobs.items()}
            for task in as_completed(tasks):
                yield tasks[task], task.result()
            pool.shutdown()
        except BaseException:  # Ctrl-C as well: nothing goes on in the background
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _context() -> multiprocessing.context.BaseContext:
    """Workers come from a clean process that has loaded everything once."""
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(['waam_lab.laboratory'])
    return context


def _start() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that asked ends its workers


class _one_thread_each:
    """Workers are as many as cores, so each uses one; libraries read this when they are loaded."""

    def __enter__(self) -> None:
        self._before = {name: os.environ.get(name) for name in ONE_THREAD}
        os.environ.update(dict.fromkeys(ONE_THREAD, '1'))

    def __exit__(self, *_: object) -> None:
        for name, value in self._before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
