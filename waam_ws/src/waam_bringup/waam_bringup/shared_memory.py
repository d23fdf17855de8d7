"""Shared memory that killed processes left behind: Fast DDS frees its segments (35 MB per node) only at a clean end.

A living owner holds a lock on `<segment>_el`; one that died holds none, however it died.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from contextlib import suppress
from pathlib import Path

PLACE = Path('/dev/shm')
SEGMENT = re.compile(r'fastrtps_[0-9a-f]{16}')
YOUNG_S = 20.0  # a segment that is just being made may not be locked yet


def clean(place: Path = PLACE, young: float = YOUNG_S) -> int:
    """Removes the segments of processes of this user that are dead. Returns the bytes freed."""
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
    mark = file.with_name(f'{file.name}_el')
    lock = os.open(mark, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # OSError: its owner lives
        file.unlink()
        mark.unlink()
    finally:
        os.close(lock)
    return about.st_size
