"""Many jobs on all cores. Results come in the order of the jobs and are the same, whatever the number of workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

from .job import LabJob, LabResult
from .laboratory import failed, run

ONE_THREAD = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')


def run_many(
    jobs: Sequence[LabJob],
    workers: int = 0,
    done: Callable[[LabResult], None] | None = None,
) -> list[LabResult]:
    """One result per job. workers: 0 = one per core; done: called with every result as it comes.

    A job that is refused or that a fault of this software ends gives a result with verdict 'failed'.
    """
    workers = workers_for(workers, len(jobs))
    found: list[LabResult | None] = [None] * len(jobs)
    with _one_thread_each():
        pool = ProcessPoolExecutor(workers, _context(), _start)
        try:
            tasks = {pool.submit(_attempt, job): i for i, job in enumerate(jobs)}
            for task in as_completed(tasks):
                found[tasks[task]] = result = task.result()
                if done:
                    done(result)
            pool.shutdown()
        except BaseException:  # Ctrl-C as well: nothing goes on in the background
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise
    return [r for r in found if r is not None]


def workers_for(asked: int, jobs: int) -> int:
    """Processes that are worth it; asked: 0 = one per core."""
    return min(asked or os.cpu_count() or 1, max(1, jobs))


def _context() -> multiprocessing.context.BaseContext:
    """Workers come from a clean process that has loaded everything once."""
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(['waam_lab.laboratory'])
    return context


def _start() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that asked ends its workers


def _attempt(job: LabJob) -> LabResult:
    try:
        return run(job)
    except Exception as e:
        return failed(job, e)


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
