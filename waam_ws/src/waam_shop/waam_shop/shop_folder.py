"""Where a shop keeps its files: one folder that all its cells can reach.

<shop>/tokens.json, tokens.json.key, notify.yaml        of all cells, readable by their owner only
<shop>/cells/<name>/status.json                         what its panel tells, once a second
<shop>/cells/<name>/queue.json                          its queue
<shop>/cells/<name>/audit.jsonl, audit.head             its audit log
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waam_process.safe_files import FileError, read_text

from .audit_file import AuditLog
from .cells import NAME, CellStatus, check_name, parse
from .queue_file import QueueFile
from .token_file import TokenFile

TOKENS, STATUS = 'tokens.json', 'status.json'


@dataclass(frozen=True)
class Shop:
    """path: the folder; nothing is made before something is written."""

    path: Path

    def tokens(self) -> TokenFile:
        """Of all cells."""
        return TokenFile(self.path / TOKENS)

    def folder(self, cell: str) -> Path:
        """Of one cell. Raises ValueError for a name that is none."""
        return self.path / 'cells' / check_name(cell)

    def queue(self, cell: str) -> QueueFile:
        """Of one cell."""
        return QueueFile(self.folder(cell))

    def audit(self, cell: str) -> AuditLog:
        """Of one cell."""
        return AuditLog(self.folder(cell), cell)

    def names(self) -> list[str]:
        """All cells that have ever been here."""
        cells = self.path / 'cells'
        found = cells.iterdir() if cells.is_dir() else ()
        return sorted(f.name for f in found if f.is_dir() and NAME.fullmatch(f.name))

    def status(self, cell: str) -> CellStatus | None:
        """What the panel of a cell has told last; None when it has told nothing yet."""
        with suppress(FileError):
            return parse(cell, read_text(self.folder(cell) / STATUS, limit=1 << 20))
        return None

    def tell(self, status: CellStatus) -> None:
        """Replaces the status of a cell. Not put on the disk at once: it is worth nothing a second later."""
        folder = self.folder(status.name)
        folder.mkdir(parents=True, exist_ok=True)
        temporary = folder / f'{STATUS}.new'
        temporary.unlink(missing_ok=True)
        with open(temporary, 'x', encoding='utf-8') as f:
            f.write(status.text())
        os.replace(temporary, folder / STATUS)

    def cells(self) -> list[CellStatus]:
        """All cells that have told something, by name."""
        found = (self.status(name) for name in self.names())
        return [s for s in found if s is not None]


@dataclass(frozen=True)
class Places:
    """What the command line of a shop needs of others. shop: its folder; cell: name of the cell that is meant; store:
    puts a file where the panel of a cell finds it and returns its name; check: a setup as the panel's form takes it,
    or ValueError; is_program: whether a file is a program and not a mesh."""

    shop: Callable[[], Path]
    cell: Callable[[], str]
    store: Callable[[str, Path], str]
    check: Callable[[dict[str, Any]], dict[str, Any]]
    is_program: Callable[[Path], bool] = lambda file: False
