"""Workers that are killed: the whole of it, over processes that do real work, is in waam_lab/test/test_many.py."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ThreadPoolExecutor

import pytest

from waam_node.spread import _Worker

LARGE = 1 << 24  # bytes: far more than a pipe holds


def large(_: int) -> bytes:
    return b'x' * LARGE


def refuse(piece: int) -> int:
    raise EOFError(f'piece {piece}')


def test_a_worker_that_is_killed_while_it_answers_is_noticed():
    """Half of the answer has come; the rest never will."""
    worker = _Worker(multiprocessing.get_context('fork'), large)
    worker._pipe.send((1,))
    assert worker._pipe.poll(20)  # it has begun, and cannot go on before somebody reads
    worker.process.kill()
    worker.process.join()
    with ThreadPoolExecutor(1) as thread, pytest.raises((EOFError, OSError)):
        thread.submit(worker._pipe.recv).result(20)
    worker.close()


def test_what_the_work_raises_comes_back_and_the_worker_goes_on():
    worker = _Worker(multiprocessing.get_context('fork'), refuse)
    for piece in (1, 2):
        found, error = worker.ask(piece)
        assert found is None and isinstance(error, EOFError) and str(error) == f'piece {piece}'
    worker.close()
    worker.process.join(20)
    assert worker.process.exitcode == 0
