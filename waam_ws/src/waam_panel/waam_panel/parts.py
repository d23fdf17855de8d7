"""Folders with parts: what can be chosen, and where uploads go. No ROS."""

from __future__ import annotations

import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

from waam_process.safe_files import FileError, is_file, read_bytes

SUFFIXES = ('.stl', '.ply', '.obj', '.off')
_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9 ._+-]{0,79}')
LISTED = 500
LARGEST_PART = 1 << 30  # bytes, of a file in a queue


class PartsError(ValueError):
    """A name or file that is refused; the text says why."""


@dataclass(frozen=True)
class PartFolders:
    """The first folder takes uploads; all are searched, one level deep. In the others, which the cell's owner has
    named, links count as what they lead to: colcon installs the demo's parts as links."""

    folders: tuple[Path, ...]
    suffixes: tuple[str, ...] = SUFFIXES
    kind: str = 'part'

    def listing(self) -> list[dict[str, object]]:
        """Files that can be chosen: name, size in kB, changed (UTC, s); newest first. One entry per name."""
        found: dict[str, tuple[float, int]] = {}
        for folder in self.folders:
            for file in sorted(folder.glob('*')) if folder.is_dir() else ():
                if self._is_one(file) and file.name not in found:
                    stat = file.stat()
                    found[file.name] = (stat.st_mtime, stat.st_size)
        rows = sorted(found.items(), key=lambda item: -item[1][0])[:LISTED]
        return [{'name': n, 'kb': round(size / 1024, 1), 'time': t} for n, (t, size) in rows]

    def find(self, name: str) -> Path:
        """The file of a name from the list. Raises PartsError: names only, no paths."""
        if name != Path(name).name or name in ('', '.', '..'):
            raise PartsError(f'{name!r} is not the name of a {self.kind}')
        for folder in self.folders:
            file = folder / name
            if self._is_one(file):
                return file.resolve()
        raise PartsError(f'there is no {self.kind} {name!r}')

    def _is_one(self, file: Path) -> bool:
        there = is_file(file) if file.parent == self.folders[0] else file.is_file()
        return there and file.suffix.lower() in self.suffixes

    def save(self, name: str, data: bytes) -> str:
        """Stores an upload under its name, with a number when another file has it. Returns the name."""
        if not _NAME.fullmatch(name) or Path(name).suffix.lower() not in self.suffixes:
            raise PartsError(
                f'{name!r}: letters, digits, space and . _ + - only, ending in {", ".join(self.suffixes)}'
            )
        if not data:
            raise PartsError(f'{name}: the file is empty')
        folder = self.folders[0]
        folder.mkdir(parents=True, exist_ok=True)
        file = _free(folder, name, data)
        if not is_file(file):
            temporary = folder / f'.{file.name}.new'
            temporary.unlink(missing_ok=True)
            with open(temporary, 'xb') as f:
                f.write(data)
            os.replace(temporary, file)
        return file.name


def _free(folder: Path, name: str, data: bytes) -> Path:
    """The file to write: the name itself, the same content under it, or a numbered one."""
    file, number = folder / name, 1
    while os.path.lexists(file) and not _holds(file, data):
        number += 1
        file = folder / f'{Path(name).stem}-{number}{Path(name).suffix}'
    return file


def sha256_of(file: Path) -> str:
    """Of its content. Raises PartsError."""
    try:
        return hashlib.sha256(read_bytes(file, limit=LARGEST_PART)).hexdigest()
    except FileError as e:
        raise PartsError(str(e)) from None


def _holds(file: Path, data: bytes) -> bool:
    try:
        return read_bytes(file, limit=len(data)) == data
    except FileError:
        return False
