"""Files that others may have written: read wholly, or a `FileError` that names the file and says why. No ROS.

A job folder may come from a stranger. So nothing here follows a link out of the folder, waits for a FIFO, takes more
memory than it was told, or lets a parser's own exception out.
"""

from __future__ import annotations

import errno
import json
import math
import os
import stat
import zipfile
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import yaml

if TYPE_CHECKING:
    import numpy as np

TEXT_BYTES = 64 << 20  # of JSON, YAML and text
ARRAY_BYTES = 1 << 30  # of all arrays of an npz file together, unpacked
VALUES = 5_000_000  # of a JSON or YAML file, aliases followed
DEEPEST = 200  # lists and mappings within each other
MAX_INTEGER = 1 << 1023  # of a whole number: what a double holds
MEMBERS = 1000  # arrays of an npz file
Parsed = TypeVar('Parsed')


class FileError(ValueError):
    """A file that cannot be read as what it should be; the text names it and says why."""


class Missing(FileError, FileNotFoundError):
    """There is no such file."""


@contextmanager
def opened(file: Path, folder: Path | None = None) -> Iterator[BinaryIO]:
    """A regular file, for reading. FileError; Missing.

    folder: of the job, which somebody named; below it no symbolic link is followed, and there is no way up. None: the
    folder that the file lies in.
    """
    folder = file.parent if folder is None else folder
    try:
        names = PurePosixPath(file.relative_to(folder)).parts
    except ValueError:
        raise FileError(f'{file}: not below {folder}') from None
    if not names or '..' in names:
        raise FileError(f'{file}: not below {folder}')
    try:
        descriptor = _descend(folder, names)
    except (OSError, ValueError) as e:
        raise _refused(file, e) from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise FileError(f'{file}: not a regular file')
    with open(descriptor, 'rb') as f:
        yield f


def _descend(folder: Path, names: tuple[str, ...]) -> int:
    """A descriptor of folder/names, opened name by name, so that nobody can put a link in between."""
    at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        for name in names[:-1]:
            flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
            below = os.open(name, flags, dir_fd=at)
            os.close(at)
            at = below
        flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
        return os.open(names[-1], flags, dir_fd=at)
    finally:
        os.close(at)


def _refused(file: Path, e: OSError | ValueError) -> FileError:
    if isinstance(e, FileNotFoundError):
        return Missing(f'{file}: no such file')
    if isinstance(e, OSError) and e.errno == errno.ELOOP:
        return FileError(f'{file}: a symbolic link, which is not followed')
    if isinstance(e, NotADirectoryError):
        return FileError(f'{file}: a symbolic link or a file stands for a folder of its path')
    return FileError(f'{file}: cannot be read ({getattr(e, "strerror", None) or e})')


def is_file(file: Path) -> bool:
    """A regular file that is no symbolic link."""
    try:
        return stat.S_ISREG(file.lstat().st_mode)
    except (OSError, ValueError):
        return False


def read_bytes(file: Path, folder: Path | None = None, limit: int = TEXT_BYTES) -> bytes:
    """Content of a regular file; folder as of `opened`. FileError, also above `limit` bytes."""
    with opened(file, folder) as f:
        size = os.fstat(f.fileno()).st_size
        if size > limit:
            raise FileError(f'{file}: {size} bytes, at most {limit} are read')
        try:
            data = f.read(limit + 1)
        except (OSError, MemoryError) as e:
            raise FileError(f'{file}: cannot be read ({e or "not enough memory"})') from None
    if len(data) < size or len(data) > limit:
        raise FileError(f'{file}: its size changed while it was read')
    return data


def read_text(file: Path, folder: Path | None = None, limit: int = TEXT_BYTES) -> str:
    """UTF-8, without a byte order mark. FileError."""
    data = read_bytes(file, folder, limit)
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError as e:
        raise FileError(f'{file}: no UTF-8 text (byte {e.start})') from None


def read_json(file: Path, folder: Path | None = None) -> Any:
    """FileError; as of `parse_json`."""
    return parse_json(read_text(file, folder), str(file))


def read_yaml(file: Path, folder: Path | None = None) -> Any:
    """FileError; as of `parse_yaml`."""
    return parse_yaml(read_text(file, folder), str(file))


def read_mapping(file: Path, folder: Path | None = None) -> dict[str, Any]:
    """The mapping in a JSON (.json) or YAML file. FileError."""
    data = read_json(file, folder) if file.suffix == '.json' else read_yaml(file, folder)
    if not isinstance(data, dict):
        raise FileError(f'{file}: damaged (it holds no mapping)')
    return data


def parse_json(text: str, name: str, finite: bool = True) -> Any:
    """JSON as the standard has it: no NaN, no Infinity, no number beyond a double, no key twice. FileError.

    finite: False where NaN and Infinity mean something, as in parameters of nodes.
    """
    decoder = _decoder if finite else _open_decoder
    return _parsed(name, lambda: _bounded(decoder.decode(text.strip())))


def parse_yaml(text: str, name: str) -> Any:
    """YAML 1.1 without tags of programs and without a key twice; what aliases unfold to is counted. FileError."""
    return _parsed(name, lambda: _bounded(yaml.load(text, _Loader)))


def _parsed(name: str, parse: Callable[[], Parsed]) -> Parsed:
    try:
        return parse()
    except RecursionError:
        reason = 'nested too deeply'
    except MemoryError:
        reason = 'not enough memory for it'
    except Exception as e:  # parsers raise what they like for damaged bytes
        reason = ' '.join(str(e).split())[:200] or type(e).__name__
    raise FileError(f'{name}: damaged ({reason})')


def _pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [k for k, _ in pairs]
        raise ValueError(f'key {next(k for k in keys if keys.count(k) > 1)[:60]!r} is there twice')
    return found


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f'{text[:30]} is no finite number')
    return value


_decoder = json.JSONDecoder(object_pairs_hook=_pairs, parse_float=_float, parse_constant=_float)
_open_decoder = json.JSONDecoder(object_pairs_hook=_pairs)


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """Safe, and no key twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        """As of the base. ConstructorError for a key that is there twice."""
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            known = key.tag, str(key.value) if isinstance(key, yaml.ScalarNode) else str(id(key))
            if known in seen and key.tag != 'tag:yaml.org,2002:merge':
                where = key.start_mark
                raise yaml.constructor.ConstructorError(
                    None, None, f'key {str(key.value)[:60]!r} is there twice', where
                )
            seen.add(known)
        return super().construct_mapping(node, deep)


def _bounded(data: Any) -> Any:
    """The data, unless it is too deep or too much once all that is used twice is written out. ValueError."""
    sizes: dict[int, int] = {}
    open_: list[tuple[Any, bool]] = [(data, False)]
    depth = 0
    while open_:
        value, done = open_.pop()
        if isinstance(value, int) and abs(value) >= MAX_INTEGER:
            raise ValueError('a whole number beyond a double')
        if not isinstance(value, dict | list | tuple | set) or (
            not done and sizes.get(id(value), 0) > 0
        ):
            continue
        inner = [*value, *value.values()] if isinstance(value, dict) else list(value)
        if done:
            depth -= 1
            sizes[id(value)] = 1 + sum(sizes.get(id(v), 1) for v in inner)
            if sizes[id(value)] > VALUES:
                raise ValueError(f'more than {VALUES} values')
            continue
        if id(value) in sizes:
            raise ValueError('a list or mapping holds itself')
        sizes[id(value)] = 0
        depth += 1
        if depth > DEEPEST:
            raise ValueError('nested too deeply')
        open_.append((value, True))
        open_ += [(v, False) for v in inner]
    return data


def read_npz(
    file: Path, folder: Path | None = None, limit: int = ARRAY_BYTES
) -> dict[str, np.ndarray]:
    """Arrays of an npz file by name. FileError, also where they would take more than `limit` bytes, or claim so."""
    with opened(file, folder) as f:
        return _parsed(str(file), lambda: _arrays(f, limit))


def _arrays(f: BinaryIO, limit: int) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    with zipfile.ZipFile(f) as z:
        members = z.infolist()
        if len(members) > MEMBERS or sum(m.file_size for m in members) > limit:
            raise ValueError(f'unpacked it takes more than {limit} bytes')
        for member in members:
            name = member.filename.removesuffix('.npy')
            if name in found:
                raise ValueError(f'array {name[:60]!r} is there twice')
            with z.open(member) as stream:
                found[name] = _array(stream, member.file_size)
    return found


def _array(stream: Any, size: int) -> np.ndarray:
    """ValueError where the header claims another size than the member has."""
    import numpy as np  # the command line reads its files without it

    version = np.lib.format.read_magic(stream)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in read:
        raise ValueError(f'array format {version}')
    shape, fortran, dtype = read[version](stream)
    if dtype.hasobject:
        raise ValueError('it holds objects, not numbers')
    if math.prod(shape) * dtype.itemsize != size - stream.tell():
        raise ValueError(f'an array claims shape {shape[:8]}, which is not what it holds')
    data = np.frombuffer(stream.read(), dtype)
    return data.reshape(shape, order='F' if fortran else 'C').copy()
