"""An end for a benchmark that hangs: it fails with a sentence instead of holding up the ones behind it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def within(seconds: float, what: str) -> Iterator[None]:
    """TimeoutError in the main thread when the block takes longer (wall time); `finally` of the block still runs."""

    def over(*_: object) -> None:
        raise TimeoutError(f'{what} did not end within {seconds:.0f} s')

    before = signal.signal(signal.SIGALRM, over)
    signal.alarm(max(1, round(seconds)))
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
