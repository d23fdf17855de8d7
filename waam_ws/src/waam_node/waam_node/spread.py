"""Work spread over processes of this machine. No ROS.

Pieces of work know nothing of one another, so results are the same, whatever the number of workers. A worker that is
lost costs its own piece, which is done again; the others go on.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any, Generic, TypeVar

Key = TypeVar('Key')
Piece = TypeVar('Piece')
Result = TypeVar('Result')
ONE_THREAD = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS')
TRIES = 3  # workers that a piece may lose
NO_MORE = ()  # in place of a piece: the worker may go


class WorkerLost(Exception):
    """The processes of a piece of work were killed; the text says how many."""


@dataclass(frozen=True)
class Workers:
    """Who does the work. count: processes, 0 = one per core. preload: modules that every process needs; they are loaded
    once."""

    count: int = 0
    preload: tuple[str, ...] = ()

    def for_pieces(self, pieces: int) -> int:
        """Processes that are worth it."""
        return min(self.count or os.cpu_count() or 1, max(1, pieces))


def add_options(p: argparse.ArgumentParser) -> None:
    """--workers of a command; `Workers(args.workers, ...)`."""
    text = 'processes; 0 = one per core (default)'
    p.add_argument('--workers', type=int, default=0, metavar='N', help=text)


def spread(
    pieces: Mapping[Key, Piece],
    work: Callable[[Piece], Result],
    lost: Callable[[Piece, Exception], Result],
    workers: Workers,
) -> Generator[tuple[Key, Result], None, None]:
    """Results as they come, one per piece.

    work: a function of a module, which catches what may end it. lost: the result of a piece whose worker was lost
    again and again. What is under way ends when the caller stops.
    """
    if not pieces:
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
        self._started: list[_Worker] = []

    def do(self, piece: Piece) -> Result:
        """Its result; that of `lost` when its process was lost TRIES times."""
        for _ in range(TRIES):
            worker = self._worker()
            try:
                found, error = worker.ask(piece)
            except (EOFError, OSError):  # it has ended, perhaps in the middle of its answer
                worker.close()
                self._mine.worker = None
                continue
            if error is not None:
                raise error
            return found
        return self._lost(piece, WorkerLost(f'{TRIES} workers were lost one after the other'))

    def _worker(self) -> _Worker:
        with self._lock:  # one process is started at a time
            if self._over:
                raise WorkerLost('all workers were dismissed')
            if getattr(self._mine, 'worker', None) is None:
                self._mine.worker = _Worker(self._context, self._work)
                self._started.append(self._mine.worker)
            worker: _Worker = self._mine.worker
            return worker

    def dismiss(self) -> None:
        """All processes end at once, whatever they do."""
        with self._lock:
            self._over = True
            for worker in self._started:
                worker.process.terminate()
        self.end()

    def end(self) -> None:
        """No process is left."""
        for worker in self._started:
            worker.close()
        for worker in self._started:
            worker.process.join()


class _Worker:
    """A process that answers one piece after the other. Its end of the pipe is closed on this side, so what it leaves
    unsaid when it is killed ends the reading; a pool of the standard library waits for the rest for ever."""

    def __init__(self, start: BaseContext, work: Callable[[Any], Any]) -> None:
        self._pipe, far = multiprocessing.Pipe()
        # one that outlives this process would wait for nobody
        self.process = start.Process(target=_serve, args=(far, work), daemon=True)  # type: ignore[attr-defined]
        self.process.start()
        far.close()

    def ask(self, piece: Any) -> tuple[Any, Exception | None]:
        """(result, None), or (None, what the work raised). EOFError or OSError when the process is gone."""
        self._pipe.send((piece,))
        found: tuple[Any, Exception | None] = self._pipe.recv()
        return found

    def close(self) -> None:
        """The process ends after what it is at."""
        if not self._pipe.closed:
            with suppress(OSError):  # it is gone already
                self._pipe.send(NO_MORE)
            self._pipe.close()


def _serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    """In the process of a worker, until there is nobody to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that asked ends its workers
    while True:
        try:
            order = pipe.recv()
        except (EOFError, OSError):
            return
        if order == NO_MORE:
            return
        answer = _answer(work, *order)
        try:
            pipe.send(answer)
        except OSError:
            return
        except Exception as e:  # it cannot be sent as it is
            pipe.send((None, e))


def _answer(work: Callable[[Any], Any], piece: Any) -> tuple[Any, Exception | None]:
    try:
        return work(piece), None
    except Exception as e:
        return None, e


def context(preload: tuple[str, ...]) -> BaseContext:
    """Workers come from a clean process that has loaded everything once."""
    found = multiprocessing.get_context('forkserver')
    found.set_forkserver_preload(list(preload))
    return found


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
