"""Files that survive a kill or a power cut as the old or the new whole, and what one process has while it lives."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from waam_node.files import sync_folder


def write_durably(path: Path, text: str, mode: int = 0o644) -> None:
    """The file is either the old or the new one; once this returns it is the new one, also after a power cut."""
    temporary = path.with_name(path.name + '.new')
    temporary.unlink(missing_ok=True)  # of a writer that was killed, perhaps with other rights
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with open(descriptor, 'w', encoding='utf-8') as f:
        f.write(text)
        f.flush()
        os.fsync(f.fileno())
    os.replace(temporary, path)
    sync_folder(path.parent)


class Ownership:
    """A lock that a process holds as long as it lives: one panel runs the queue of a cell."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor = -1

    def take(self) -> bool:
        """True when it is ours, now or already."""
        if self._descriptor >= 0:
            return True
        self._path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        self._descriptor = descriptor
        return True

    def give(self) -> None:
        """Lets go of it."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
