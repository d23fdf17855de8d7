"""The audit log of a cell on disk: appended to under a lock, on the disk before the command goes on."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from waam_node.locks import PATIENCE_S, locked

from .audit import FIRST, AuditError, Entry, Verdict, clean, hidden, parse, verify
from .durable import write_durably

NAME, HEAD = 'audit.jsonl', 'audit.head'
BLOCK = 64 << 10  # read from the end to find the last entry; more where that holds no whole line


class AuditLog:
    """folder: of the cell in the shop; cell: its name in the entries."""

    def __init__(self, folder: Path, cell: str) -> None:
        self.path, self.head = folder / NAME, folder / HEAD
        self.cell = cell

    def write(
        self, what: str, who: str, via: str, outcome: str = 'asked', role: str = '',
        data: Mapping[str, Any] | None = None, note: str = '', patience: float = PATIENCE_S,
    ) -> Entry:  # fmt: skip
        """Appends an entry; it is on the disk when this returns. Secrets in `data` and `note` are hidden; what is too
        long for a reader is cut, and marked so. OSError, also when the lock stays held for `patience` s."""
        with locked(self.path.with_name(NAME + '.lock'), patience):
            n, prev, torn, missing = self._end()
            made = Entry(
                n=n + 1, utc=round(time.time(), 3), cell=self.cell, who=clean(who), role=clean(role), via=via,
                what=clean(what)[:80], outcome=outcome, data=hidden(data or {}), note=clean(note), torn=torn,
                missing=missing, prev=prev,
            )  # fmt: skip
            entry = Entry(**{**vars(made), 'hash': made.computed()})
            self._append(('\n' if torn else '') + entry.line())
            write_durably(self.head, json.dumps({'n': entry.n, 'hash': entry.hash}))
        return entry

    def _append(self, text: str) -> None:
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o640)
        with open(descriptor, 'wb') as f:
            f.write(text.encode())
            f.flush()
            os.fsync(f.fileno())

    def _end(self) -> tuple[int, str, str, int]:
        """Number and hash of the last entry, hash of an unfinished line behind it, how many entries are missing."""
        n, prev, torn = 0, FIRST, ''
        lines = self._tail()
        if lines and lines[-1]:
            torn = hashlib.sha256(lines[-1]).hexdigest()
        for line in reversed(lines[:-1]):
            try:
                last = parse(line)
            except AuditError:
                continue  # of an earlier power cut, or damaged: verify tells
            n, prev = last.n, last.hash
            break
        known = self._known()
        if known and known[0] > n:
            return known[0], known[1], torn, known[0] - n
        return n, prev, torn, 0

    def _tail(self) -> list[bytes]:
        """The last lines; behind the last line's end there is nothing, or the unfinished one."""
        with suppress(FileNotFoundError), open(self.path, 'rb') as f:
            size = f.seek(0, os.SEEK_END)
            block = BLOCK
            while True:
                f.seek(max(0, size - block))
                lines = f.read().split(b'\n')
                if size <= block:
                    return lines
                if len(lines) > 2:  # the first one has lost its beginning
                    return lines[1:]
                block *= 4
        return []

    def _known(self) -> tuple[int, str] | None:
        """What the head file says; None without one."""
        try:
            data = json.loads(self.head.read_text(encoding='utf-8'))
            return int(data['n']), str(data['hash'])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError):
            return 0, ''  # damaged: verify tells

    def verify(self, expect: str = '') -> Verdict:
        """Walks the whole log. expect: a hash that was kept elsewhere."""
        with locked(self.path.with_name(NAME + '.lock')):  # to see where it ends; then others write
            known = self._known()
            size = self.path.stat().st_size if self.path.exists() else 0
        found = verify(self.lines(size), known, expect)
        if known is None and found.entries:
            found.problems.append('the head file is missing')
        return found

    def lines(self, size: int | None = None) -> Iterator[bytes]:
        """All lines without their ends; size: of the first so many bytes."""
        with suppress(FileNotFoundError), open(self.path, 'rb') as f:
            for line in f:
                if size is not None:
                    if size <= 0:
                        return
                    line, size = line[:size], size - len(line)
                yield line.rstrip(b'\n')

    def last(self, count: int) -> list[Entry]:
        """The newest entries that can be read, oldest first."""
        found: list[Entry] = []
        for line in self.lines():
            with suppress(AuditError):
                found.append(parse(line))
                del found[:-count]
        return found
