"""Many jobs on all cores. Results come in the order of the jobs and are the same, whatever the number of workers.

How they are spread: waam_node.spread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from waam_node.spread import Workers, spread

from .job import LabJob, LabResult
from .laboratory import failed, run
from .pieces import Pieces

PRELOAD = ('waam_lab.laboratory',)


def run_many(
    jobs: Sequence[LabJob],
    workers: int = 0,
    done: Callable[[LabResult], None] | None = None,
    pieces: Pieces | None = None,
) -> list[LabResult]:
    """One result per job. workers: 0 = one per core; done: called with every result as it comes.

    pieces: where results are kept as they come; jobs that it has are not run again.
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
    for i, result in spread(waiting, attempt, failed, Workers(workers, PRELOAD)):
        if pieces and not result.failed:
            pieces.write(waiting[i], result)
        take(i, result)
    return [found[i] for i in range(len(jobs))]


def workers_for(asked: int, jobs: int) -> int:
    """Processes that are worth it; asked: 0 = one per core."""
    return Workers(asked).for_pieces(jobs)


def attempt(job: LabJob) -> LabResult:
    """One job in a worker; whatever ends it is a result."""
    try:
        return run(job)
    except Exception as e:
        return failed(job, e)
