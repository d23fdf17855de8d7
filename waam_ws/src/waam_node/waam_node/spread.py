"""Work spread over processes of this machine, or over a Ray cluster. No ROS.

Pieces of work know nothing of one another, so results are the same, whatever the number of workers and machines. A
worker that is lost costs the pieces that were under way, which are done again; on a cluster its own piece only.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.context import BaseContext
from typing import TypeVar

Key = TypeVar('Key')
Piece = TypeVar('Piece')
Result = TypeVar('Result')
ONE_THREAD = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
TRIES = 3  # pools that may break one after the other without a result


@dataclass(frozen=True)
class Workers:
    """Who does the work. count: processes, 0 = one per core. cluster: address of a Ray cluster ('auto', HOST:PORT,
    ray://HOST:PORT) that does it instead. preload: modules that every process needs; they are loaded once."""

    count: int = 0
    cluster: str = ''
    preload: tuple[str, ...] = ()

    def for_pieces(self, pieces: int) -> int:
        """Processes that are worth it."""
        return min(self.count or os.cpu_count() or 1, max(1, pieces))


def add_options(p: argparse.ArgumentParser, what: str = '') -> None:
    """--workers and --cluster of a command; `Workers(args.workers, args.cluster, ...)`. what: one of them does."""
    text = f'processes; 0 = one per core (default){"; " if what else ""}{what}'
    p.add_argument('--workers', type=int, default=0, metavar='N', help=text)
    p.add_argument(
        '--cluster',
        default='',
        metavar='ADDRESS',
        help="an existing Ray cluster does the work: HOST:PORT, ray://HOST:PORT, or 'auto' for the one of this machine "
        '(requirements-cluster.txt)',
    )


def spread(
    pieces: Mapping[Key, Piece],
    work: Callable[[Piece], Result],
    lost: Callable[[Piece, Exception], Result],
    workers: Workers,
) -> Iterator[tuple[Key, Result]]:
    """Results as they come, one per piece. ClusterError when there is no cluster at the address.

    work: a function of a module, which catches what may end it. lost: the result of a piece whose worker was lost
    again and again. What is under way ends when the caller stops.
    """
    if not pieces:
        return
    if workers.cluster:
        from .ray_cluster import results

        yield from results(pieces, work, lost, workers.cluster, ONE_THREAD)
        return
    left, breaks = dict(pieces), 0
    while left:
        try:
            for key, result in _pool(left, work, workers):
                del left[key]
                breaks = 0
                yield key, result
        except BrokenProcessPool as e:
            breaks += 1
            if breaks == TRIES:
                yield from ((key, lost(piece, e)) for key, piece in left.items())
                return


def _pool(
    pieces: Mapping[Key, Piece], work: Callable[[Piece], Result], workers: Workers
) -> Iterator[tuple[Key, Result]]:
    """Raises BrokenProcessPool when a worker was killed; what came before has been told."""
    with _one_thread_each():
        count = workers.for_pieces(len(pieces))
        pool = ProcessPoolExecutor(count, context(workers.preload), _start)
        try:
            tasks = {pool.submit(work, piece): key for key, piece in pieces.items()}
            for task in as_completed(tasks):
                yield tasks[task], task.result()
            pool.shutdown()
        except BaseException:  # Ctrl-C as well: nothing goes on in the background
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def context(preload: tuple[str, ...]) -> BaseContext:
    """Workers come from a clean process that has loaded everything once."""
    found = multiprocessing.get_context('forkserver')
    found.set_forkserver_preload(list(preload))
    return found


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
