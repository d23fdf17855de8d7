"""The ZIP package of a 3MF file: its parts by name, its start part, XML that is read safely."""

from __future__ import annotations

import io
import posixpath
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from xml.parsers import expat

from waam_plan.texts import shown

MAX_UNPACKED_BYTES = 1_000_000_000  # bytes of all parts that are read
MAX_PACKED = 200  # times; a model of numbers is packed five to twenty times
SMALL = 10_000_000  # bytes, which may be packed as they like
CHUNK = 1_000_000  # bytes
DEEPEST = 64  # elements in elements
MODEL = '/3dmodel'  # end of the type of the relationship that names the start part


class Package:
    """Parts by their name without the leading '/', in small letters. ValueError says what is wrong with the package."""

    def __init__(self, data: bytes) -> None:
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
            held = self._zip.infolist()
        except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError) as error:
            raise ValueError(f'not a readable archive ({error})') from error
        self._held: dict[str, zipfile.ZipInfo] = {}
        for info in held:
            name = info.filename.lstrip('/').lower()
            if name in self._held:
                raise ValueError(f'the archive holds {shown(info.filename)} twice')
            if '..' in name.split('/') or '\\' in info.filename:
                raise ValueError(
                    f'the archive holds {shown(info.filename)}, which is no name of a part'
                )
            self._held[name] = info
        self._left = MAX_UNPACKED_BYTES

    @property
    def names(self) -> list[str]:
        """Of all parts, in the order of the archive."""
        return list(self._held)

    def read(self, name: str) -> bytes:
        """What a small part holds."""
        return b''.join(self.chunks(name))

    def chunks(self, name: str) -> Iterator[bytes]:
        """What a part holds, piece by piece."""
        if name not in self._held:
            raise ValueError(f'{shown(name)} is referred to, but not in the archive')
        info = self._held[name]
        if info.flag_bits & 1:
            raise ValueError(f'{shown(name)} is encrypted; save it without a password')
        if info.file_size > max(SMALL, MAX_PACKED * info.compress_size):
            raise ValueError(
                f'{shown(name)} is packed {info.file_size // max(1, info.compress_size)} times, which no model is'
            )
        try:
            with self._zip.open(info) as f:
                while piece := f.read(CHUNK):
                    self._left -= len(piece)
                    if self._left < 0:
                        raise ValueError(
                            f'the parts are larger than {MAX_UNPACKED_BYTES // 1_000_000} MB'
                        )
                    yield piece
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            NotImplementedError,
            RuntimeError,
            OSError,
        ) as e:
            raise ValueError(f'{shown(name)}: not a readable archive ({e})') from e

    def start(self) -> str:
        """Name of the part with the build, as `_rels/.rels` says; without that file the only model there is."""
        if '_rels/.rels' not in self._held:
            models = [n for n in self._held if n.endswith('.model')]
            if not models:
                raise ValueError('there is no .model in the archive')
            if len(models) > 1:
                raise ValueError(
                    '_rels/.rels, which says where the model begins, is not in the archive'
                )
            return models[0]
        found: list[Mapping[str, str]] = []

        def open_(tag: str, attributes: dict[str, str]) -> None:
            if tag == 'Relationship' and attributes.get('Type', '').endswith(MODEL):
                found.append(attributes)

        parse(
            self.chunks('_rels/.rels'), '_rels/.rels', lambda tag, a: open_(tag.split(' ')[-1], a)
        )
        if len({a.get('Target') for a in found}) != 1:
            raise ValueError(f'_rels/.rels names {len(found)} models to begin with, not one')
        if found[0].get('TargetMode', '').lower() == 'external':
            raise ValueError('_rels/.rels: the model lies outside of the archive')
        return part_name(found[0].get('Target', ''), '')


def part_name(path: str, beside: str) -> str:
    """Name of the part that `path` refers to, from the part `beside`."""
    if not path:
        raise ValueError(f'{beside or "_rels/.rels"}: an empty name of a part')
    whole = path if path.startswith('/') else posixpath.join('/', posixpath.dirname(beside), path)
    return posixpath.normpath(whole).lstrip('/').lower()


def parse(
    text: Iterable[bytes],
    name: str,
    start: Callable[[str, dict[str, str]], None],
    end: Callable[[str], None] = lambda tag: None,
    characters: Callable[[str], None] = lambda text: None,
    prefixes: dict[str, str] | None = None,
) -> None:
    """Calls start(tag, attributes), end(tag) and characters(text), names as 'namespace local'.

    ValueError names part, line and fault.

    prefixes: gets the namespace of every prefix. Document types, and with them entities, are refused.
    """
    parser = expat.ParserCreate(namespace_separator=' ')
    parser.buffer_text = True
    depth = 0

    def refuse(*_: object) -> None:
        raise ValueError('it declares a document type; 3MF has none')

    def open_(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise ValueError(f'more than {DEEPEST} elements within each other')
        start(tag, attributes)

    def close(tag: str) -> None:
        nonlocal depth
        depth -= 1
        end(tag)

    def declared(prefix: str | None, uri: str) -> None:
        if prefixes is not None:
            prefixes.setdefault(prefix or '', uri)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = open_, close
    parser.CharacterDataHandler = characters
    parser.StartNamespaceDeclHandler = declared
    try:
        for piece in text:
            parser.Parse(piece, False)
        parser.Parse(b'', True)
    except expat.ExpatError as error:
        raise ValueError(f'{shown(name)} is not readable XML ({error})') from error
    except ValueError as error:
        line = parser.CurrentLineNumber
        raise ValueError(f'{shown(name)}, line {line}: {error}') from None
