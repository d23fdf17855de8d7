"""Work spread over processes of this machine, or over a Ray cluster. No ROS.

Pieces of work know nothing of one another, so results are the same, whatever the number of workers and machines. A
worker that is lost costs its own piece, which is done again; the others go on.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.context import BaseContext
from typing import Generic, TypeVar

Key = TypeVar('Key')
Piece = TypeVar('Piece')
Result = TypeVar('Result')
ONE_THREAD = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
TRIES = 3  # workers that a piece may lose


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
    crew = _Crew(work, lost, workers.preload)
    with _one_thread_each(), ThreadPoolExecutor(workers.for_pieces(len(pieces))) as threads:
        tasks = {threads.submit(crew.do, piece): key for key, piece in pieces.items()}
        try:
            for task in as_completed(tasks):
                yield tasks[task], task.result()
        except BaseException:  # Ctrl-C as well: nothing goes on in the background
            threads.shutdown(wait=False, cancel_futures=True)
            crew.dismiss()
            raise
        crew.end()


class _Crew(Generic[Piece, Result]):
    """A process for every thread that calls `do`, so that one that is lost takes nothing of the others with it."""

    def __init__(
        self,
        work: Callable[[Piece], Result],
        lost: Callable[[Piece, Exception], Result],
        preload: tuple[str, ...],
    ) -> None:
        self._work, self._lost, self._context = work, lost, context(preload)
        self._mine, self._lock, self._over = threading.local(), threading.Lock(), False
        self._started: list[ProcessPoolExecutor] = []
        self._others = set(multiprocessing.active_children())

    def do(self, piece: Piece) -> Result:
        """Its result; that of `lost` when its process was lost TRIES times."""
        error: Exception
        for _ in range(TRIES):
            try:
                return self._submit(piece).result()
            except BrokenProcessPool as e:
                self._mine.pool, error = None, e
        return self._lost(piece, error)

    def _submit(self, piece: Piece) -> Future[Result]:
        with self._lock:  # one process is started at a time
            if self._over:
                raise BrokenProcessPool('ended')
            if getattr(self._mine, 'pool', None) is None:
                self._mine.pool = ProcessPoolExecutor(1, self._context, _start)
                self._started.append(self._mine.pool)
            pool: ProcessPoolExecutor = self._mine.pool
            return pool.submit(self._work, piece)

    def dismiss(self) -> None:
        """All processes end at once, whatever they do."""
        with self._lock:
            self._over = True
            for child in set(multiprocessing.active_children()) - self._others:
                child.terminate()
        self.end()

    def end(self) -> None:
        """No process is left."""
        for pool in self._started:
            pool.shutdown()


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
