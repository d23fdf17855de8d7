"""The queue of a cell on disk: one small file, replaced as a whole under a lock between processes.

A change has happened once `change` returns, also when the process is killed or the power fails right after; before,
it has happened as a whole or not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from waam_node.locks import locked
from waam_process.safe_files import FileError, read_text

from .durable import write_durably
from .job_queue import Queue, QueueError

NAME = 'queue.json'


class QueueFile:
    """folder: of the cell in the shop; made with the first change."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self._stamp: tuple[int, int, int] | None = None
        self._queue = Queue()

    def read(self) -> Queue:
        """The newest queue; empty when there is no file. Raises QueueError for a damaged one."""
        try:
            status = self.path.stat()
            stamp = (status.st_mtime_ns, status.st_size, status.st_ino)
            if stamp != self._stamp:
                self._queue = Queue.parse(read_text(self.path))
                self._stamp = stamp
        except FileNotFoundError:
            self._stamp, self._queue = None, Queue()
        except FileError as e:
            self._stamp = None
            raise QueueError(str(e)) from None
        except (OSError, QueueError) as e:
            self._stamp = None
            raise QueueError(f'{self.path}: {e}') from None
        return self._queue

    def change(self, change: Callable[[Queue], Queue]) -> Queue:
        """Reads, changes, writes, under the lock. Raises QueueError (then nothing has changed) and OSError, also when
        the lock stays held."""
        with locked(self.path.with_name(NAME + '.lock')):
            self._stamp = None  # two changes within one tick of the file system's clock
            before = self.read()
            after = change(before)
            if after != before:
                write_durably(self.path, after.text())
                self._stamp = None
        return after
