"""Locks between processes that nobody waits for without an end. No ROS."""

from __future__ import annotations

import errno
import fcntl
import os
import random
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PATIENCE_S = 5.0
AGAIN_S = 0.01  # between tries, at first


@contextmanager
def locked(path: Path, patience: float | None = None) -> Iterator[None]:
    """Waits at most `patience` s (PATIENCE_S when none is said) until no other process (or thread) has this lock; the
    folder is made. Let go by the end of the block or of the process, whichever comes first. OSError (EBUSY) with the
    holder when it stays held."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        _take(descriptor, path, PATIENCE_S if patience is None else patience)
        yield
    finally:
        os.close(descriptor)


def _take(descriptor: int, path: Path, patience: float) -> None:
    end, pause = time.monotonic() + patience, AGAIN_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() >= end:
                text = f'held for more than {patience:g} s by {holder(descriptor)}'
                raise OSError(errno.EBUSY, text, str(path)) from None
        time.sleep(pause * random.uniform(0.5, 1.0))  # so that two who wait take turns
        pause = min(2 * pause, 10 * AGAIN_S)


def holder(descriptor: int) -> str:
    """Who has the lock of this file: number and command of the process, as far as the system tells."""
    status = os.fstat(descriptor)
    wanted = f':{status.st_ino}'
    with suppress(OSError):
        for line in Path('/proc/locks').read_text().splitlines():
            words = line.split()
            if len(words) > 5 and '->' not in words and words[5].endswith(wanted):
                return _named(words[4])
    return 'another process'


def _named(pid: str) -> str:
    try:
        words = Path(f'/proc/{pid}/cmdline').read_bytes().decode(errors='replace').split('\0')
    except OSError:
        return f'process {pid}'
    return f'process {pid} ({" ".join(words).strip()[:80]})'
