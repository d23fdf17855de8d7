"""An archive on an S3-compatible store: copied to a folder beside the jobs, asked there, and copied back.

Files of an archive never change; only markers and three small files (OTHERS) do. So what is in the folder already is
not copied again, and a copy that was broken off is finished by the next one. pyarrow's own file systems do the copying:
s3://, and file:// for a folder that only copies may touch. A store has no locks: one process at a time may write into
it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from pyarrow import fs

from .catalog import ArchiveError, Catalog, File, marker_name, parse
from .schema import BULK
from .store import DELETED, HEAD, RETENTION, Store

OTHERS = (HEAD, DELETED, RETENTION)  # small files that change
Tick = Callable[[int, int], None]  # files done, of how many


class Remote:
    """place: s3://BUCKET/FOLDER; `?endpoint_override=HOST:PORT&scheme=http` names a store other than Amazon's. Keys
    come from where AWS programs have them (environment, profile). local: folder of the copy. ArchiveError for an
    address that means nothing."""

    def __init__(self, place: str, local: Path) -> None:
        try:
            self.files, self.root = fs.FileSystem.from_uri(place)
        except (ValueError, OSError) as e:
            said = _one_line(e).replace(place, _plain(place))
            raise ArchiveError(f'{_plain(place)}: {said}') from None
        self.place, self.local, self.store = _plain(place), local, Store(local)

    def pull(self, bulk: bool, tick: Tick = lambda done, of: None) -> Store:
        """The copy as the store has it now; bulk: with telemetry and maps. ArchiveError."""
        for last in (False, True):
            try:
                return self._pull(bulk, tick)
            except FileNotFoundError as e:  # another process has merged segments: look again
                if last:
                    raise ArchiveError(f'{self.place}: {_one_line(e)}') from None
            except OSError as e:
                raise ArchiveError(f'{self.place}: {_one_line(e)}') from None
        raise AssertionError('not reached')

    def _pull(self, bulk: bool, tick: Tick) -> Store:
        there = self._listed()
        markers = [n for n in there if n.startswith('segments/') and n.endswith('.json')]
        texts = {n: self._read(n) for n in markers}
        catalog = Catalog.of(parse(t.decode(), f'{self.place}/{n}') for n, t in texts.items())
        wanted = [
            f for n, f in catalog.all_files().items() if bulk or n.partition('/')[0] not in BULK
        ]
        missing = [f for f in wanted if _size(self.local / f.name) != f.bytes]
        for done, f in enumerate(missing):
            self._fetch(f.name)
            tick(done + 1, len(missing))
        for name in OTHERS:
            if name in there:
                self._fetch(name)
        if RETENTION not in there:  # another computer has cleared it
            (self.local / RETENTION).unlink(missing_ok=True)
        for name, data in texts.items():
            _write(self.local / name, data)
        for file in (self.local / 'segments').glob('*.json'):
            if f'segments/{file.name}' not in texts:
                file.unlink()
        return self.store

    def push(self, tick: Tick = lambda done, of: None) -> int:
        """Copies what the store lacks, markers last, and then removes what does not count any more; how many files were
        copied. ArchiveError."""
        try:
            return self._push(tick)
        except OSError as e:
            raise ArchiveError(f'{self.place}: {_one_line(e)}') from None

    def _push(self, tick: Tick) -> int:
        catalog, there = self.store.catalog(), self._listed()
        files = catalog.all_files()
        new = [
            f.name
            for f in files.values()
            if there.get(f.name) != f.bytes and _size(self.local / f.name) == f.bytes
        ]
        lost = [n for n, f in files.items() if n not in new and there.get(n) != f.bytes]
        if lost:
            raise ArchiveError(f'{self.place}: {lost[0]} is neither there nor in {self.local}')
        markers = [marker_name(n) for n in catalog.segments]
        new += [n for n in markers if n not in there]
        heads = [n for n in OTHERS if (self.local / n).is_file()]
        for done, name in enumerate([*heads, *new]):
            self._send(name, self.local / name)
            tick(done + 1, len(new) + len(heads))
        if RETENTION in there and RETENTION not in heads:
            self.files.delete_file(f'{self.root}/{RETENTION}')
        old = set(there) - set(files) - set(markers) - set(OTHERS)
        for name in sorted(old, key=lambda n: not n.endswith('.json')):  # markers first
            if name.partition('/')[0] in ('segments', *BULK):
                self.files.delete_file(f'{self.root}/{name}')
        return len(new)

    def put(self, folder: Path) -> None:
        """Every file of a folder, below the address. ArchiveError."""
        try:
            for file in sorted(f for f in folder.rglob('*') if f.is_file()):
                self._send(file.relative_to(folder).as_posix(), file)
        except OSError as e:
            raise ArchiveError(f'{self.place}: {_one_line(e)}') from None

    def wrong_with(self, file: File) -> str:
        """'' when the bytes on the store, which are read anew, are those that were written."""
        place = f'{self.place}/{file.name}'
        try:
            data = self._read(file.name)
        except OSError as e:
            return f'{place}: {_one_line(e)}'
        if len(data) != file.bytes:
            return f'{place}: {len(data)} bytes, {file.bytes} were written'
        same = hashlib.sha256(data).hexdigest() == file.sha256
        return '' if same else f'{place}: its hash is not that of what was written'

    @property
    def empty(self) -> bool:
        """Nothing is at the address."""
        try:
            return not self._listed()
        except OSError as e:
            raise ArchiveError(f'{self.place}: {_one_line(e)}') from None

    def _listed(self) -> dict[str, int]:
        """Names below the address, and their sizes."""
        asked = fs.FileSelector(self.root, allow_not_found=True, recursive=True)
        found = [f for f in self.files.get_file_info(asked) if f.type == fs.FileType.File]
        cut = len(self.root.rstrip('/')) + 1
        return {f.path[cut:]: f.size for f in found}

    def _read(self, name: str) -> bytes:
        with self.files.open_input_stream(f'{self.root}/{name}') as source:
            return bytes(source.read())

    def _fetch(self, name: str) -> None:
        _write(self.local / name, self._read(name))

    def _send(self, name: str, file: Path) -> None:
        target = f'{self.root}/{name}'
        if isinstance(self.files, fs.LocalFileSystem):  # a store of objects has no folders
            self.files.create_dir(os.path.dirname(target), recursive=True)
        with self.files.open_output_stream(target) as out:
            out.write(file.read_bytes())


def copy_of(place: str, jobs: Path) -> Path:
    """Folder of the copy of the archive at an address."""
    return jobs / '.remote' / hashlib.sha256(place.encode()).hexdigest()[:16]


def _size(file: Path) -> int:
    return file.stat().st_size if file.is_file() else -1


def _write(file: Path, data: bytes) -> None:
    """As a whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    new = file.with_name(f'{file.name}.part')
    new.write_bytes(data)
    os.replace(new, file)


def _plain(place: str) -> str:
    """Without what may be a password: user and options."""
    scheme, _, rest = place.partition('://')
    return f'{scheme}://{rest.partition("?")[0].rpartition("@")[2]}'


def _one_line(e: Exception) -> str:
    return ' '.join(str(e).split())
