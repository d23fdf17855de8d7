"""Files that a crash must not tear. No ROS."""

from __future__ import annotations

import errno
import os
from pathlib import Path


def write_atomically(path: Path, text: str) -> None:
    """The file is either the old or the new one, also after a power cut."""
    temporary = path.with_name(path.name + '.new')
    temporary.unlink(
        missing_ok=True
    )  # of a writer that was killed, or a link that somebody put there
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
    with open(os.open(temporary, flags, 0o666), 'w', encoding='utf-8') as f:
        f.write(text)
        f.flush()
        os.fsync(f.fileno())
    os.replace(temporary, path)


def write_state(path: Path, text: str) -> None:
    """`write_atomically`; on a disk that is full the old file is written over in place, within the room that it has, so
    that how something ended is not lost. OSError where that does not suffice."""
    try:
        write_atomically(path, text)
    except OSError as e:
        if e.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        path.with_name(path.name + '.new').unlink(missing_ok=True)
        _write_over(path, text.encode(), e)


def _write_over(path: Path, data: bytes, full: OSError) -> None:
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        raise full from None
    try:
        there = os.fstat(descriptor)
        if len(data) > max(there.st_size, there.st_blocks * 512):
            raise full
        os.pwrite(
            descriptor, data.ljust(there.st_size), 0
        )  # blanks: never a torn end of the old text
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(folder: Path) -> None:
    """Puts the names in a folder on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
