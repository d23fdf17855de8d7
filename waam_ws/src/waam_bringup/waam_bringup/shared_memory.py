"""Shared memory that killed processes left behind: Fast DDS frees its segments (35 MB per node) only at a clean end.

A living owner holds a lock on `<segment>_el`; one that died holds none, however it died. The same goes for ports
(`_el`, or `_sl` when several listen). A port whose owner was killed may be unusable, and its number is then
skipped; participants with numbers from 32 on are not found by others on the same computer, so after some kills a graph
would no longer come together.

Within a graph that goes on, the ports of a killed node must not be used again: whoever sent to it may keep its memory
open and write there for good, and a successor on the same port would publish but never hear.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from collections import deque
from contextlib import ExitStack, suppress
from pathlib import Path

PLACE = Path('/dev/shm')
SEGMENT = re.compile(r'fastrtps_([0-9a-f]{16}|port[0-9]+)')
PORT_LOCK = re.compile(r'fastrtps_port[0-9]+_el')
MAX_HELD = 16  # dead nodes whose ports are held: with those of the living ones fewer than 32
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


def ports_of(pid: int) -> list[Path]:
    """Locks of the ports on which a process listens alone; none when it has ended."""
    found = set()
    with suppress(OSError):
        for link in Path(f'/proc/{pid}/fd').iterdir():
            with suppress(OSError):
                found.add(link.readlink())
    return sorted(file for file in found if PORT_LOCK.fullmatch(file.name))


class HeldPorts:
    """Ports of dead nodes, locked so that no successor takes them; the newest MAX_HELD."""

    def __init__(self) -> None:
        self._held: deque[ExitStack] = deque()

    def hold(self, locks: list[Path]) -> None:
        """locks: `ports_of` a node, taken before its end. One that somebody else has taken meanwhile is left to him."""
        stack = ExitStack()
        for path in locks:
            with suppress(OSError):
                file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
                stack.callback(os.close, file)
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._held.append(stack)
        while len(self._held) > MAX_HELD:
            self._held.popleft().close()

    def close(self) -> None:
        """Lets go of all of them."""
        while self._held:
            self._held.popleft().close()
