"""Shared memory that killed processes left behind: Fast DDS frees its segments (35 MB per node) only at a clean end.

A living owner holds a lock on `<segment>_el`; one that died holds none, however it died. The same goes for ports
(`_el`, or `_sl` when several listen). A port whose owner was killed may be unusable, and its number is then
skipped; participants with numbers from 32 on are not found by others on the same computer, so after some kills a graph
would no longer come together.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from contextlib import ExitStack, suppress
from pathlib import Path

PLACE = Path('/dev/shm')
SEGMENT = re.compile(r'fastrtps_([0-9a-f]{16}|port[0-9]+)')
YOUNG_S = 20.0  # a segment that is just being made may not be locked yet


def clean(place: Path = PLACE, young: float = YOUNG_S) -> int:
    """Removes the segments and ports of processes of this user that are dead. Returns the bytes freed."""
    if not place.is_dir():
        return 0
    freed = 0
    for file in place.iterdir():
        if SEGMENT.fullmatch(file.name):
            with suppress(OSError):
                freed += _remove_orphan(file, young)
    return freed


def _remove_orphan(file: Path, young: float) -> int:
    about = file.stat()
    if about.st_uid != os.getuid() or time.time() - about.st_mtime < young:
        return 0
    marks = [m for m in (file.with_name(f'{file.name}{e}') for e in ('_el', '_sl')) if m.exists()]
    if not marks and 'port' not in file.name:
        return 0
    with ExitStack() as locks:
        for mark in marks:
            lock = os.open(mark, os.O_RDONLY)
            locks.callback(os.close, lock)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # OSError: its owner lives
        for gone in (file, *marks, file.with_name(f'sem.{file.name}_mutex')):
            gone.unlink(missing_ok=True)
    return about.st_size
