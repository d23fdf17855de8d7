"""PCD: points of the Point Cloud Library, as text, binary or compressed (LZF)."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from waam_plan.mesh.text_cloud import INTENSITIES, Table
from waam_plan.texts import rows_of_numbers, shown

KINDS = {
    ('F', 4): '<f4', ('F', 8): '<f8', ('I', 1): '<i1', ('I', 2): '<i2', ('I', 4): '<i4', ('I', 8): '<i8',
    ('U', 1): '<u1', ('U', 2): '<u2', ('U', 4): '<u4', ('U', 8): '<u8',
}  # fmt: skip
WIDEST = 4096  # bytes of a point
UPRIGHT = [0, 0, 0, 1, 0, 0, 0]  # VIEWPOINT that changes nothing
LARGEST_RATIO = 100  # an LZF match of 3 bytes stands for 264 at most


@dataclass(frozen=True)
class _Header:
    """names, kinds (numpy), counts: of the fields, in order."""

    names: list[str]
    kinds: list[str]
    counts: list[int]
    points: int
    data: str
    notes: list[str]

    @property
    def size(self) -> int:
        """Bytes of a point."""
        return sum(np.dtype(k).itemsize * c for k, c in zip(self.kinds, self.counts, strict=True))

    def field(self, name: str) -> int:
        """Number of a field. ValueError where it is not there."""
        if self.names.count(name) != 1:
            how = 'twice' if name in self.names else 'not'
            raise ValueError(f'FIELDS ({" ".join(self.names)[:60]}) names {name} {how}')
        return self.names.index(name)


def read_pcd(data: bytes) -> Table:
    """ValueError names the entry of the header, or what is missing."""
    found = re.search(rb'^[ \t]*DATA[ \t]+(\w+)[ \t]*\r?(?:\n|\r|$)', data[:65536], re.M)
    if not found:
        raise ValueError('there is no DATA line')
    h = _header(data[: found.start()].decode('ascii', 'replace'), found[1].decode().lower())
    body = data[found.end() :]
    wanted = [h.field(a) for a in 'xyz']
    if any(h.counts[i] != 1 for i in wanted):
        raise ValueError('COUNT of x, y or z is not 1')
    lower = [n.lower() for n in h.names]
    wanted += [lower.index(n) for n in INTENSITIES if n in lower and h.counts[lower.index(n)] == 1][
        :1
    ]
    if h.data == 'ascii':
        values = _ascii(h, body, wanted)
    elif h.data == 'binary':
        values = _binary(h, body, wanted)
    elif h.data == 'binary_compressed':
        try:
            values = _compressed(h, body, wanted)
        except ValueError as e:
            raise ValueError(f'{e}; save it as binary or ascii') from None
    else:
        raise ValueError(f'DATA {h.data} is not known; save it as binary or ascii')
    return Table(values[:, :3], values[:, 3] if len(wanted) > 3 else None, '', h.notes)


def _header(text: str, data: str) -> _Header:
    words = {
        line.split()[0].upper(): line.split()[1:]
        for line in re.split(r'[\r\n]+', text)
        if line.split() and not line.lstrip().startswith('#')
    }
    for entry in ('FIELDS', 'SIZE', 'TYPE', 'WIDTH', 'HEIGHT'):
        if not words.get(entry):
            raise ValueError(f'there is no entry {entry}')
    names = words['FIELDS']
    counts = _whole(words, 'COUNT') if 'COUNT' in words else [1] * len(names)
    sizes, types = _whole(words, 'SIZE'), words['TYPE']
    if not len(names) == len(counts) == len(sizes) == len(types):
        raise ValueError('FIELDS, SIZE, TYPE and COUNT are of different lengths')
    for pair in zip(types, sizes, strict=True):
        if pair not in KINDS:
            raise ValueError(f'TYPE {pair[0]} of SIZE {pair[1]} is not known')
    kinds = [KINDS[pair] for pair in zip(types, sizes, strict=True)]
    count = _whole(words, 'WIDTH')[0] * _whole(words, 'HEIGHT')[0]
    if 'POINTS' in words and _whole(words, 'POINTS')[0] != count:
        raise ValueError(f'POINTS is {words["POINTS"][0]}, WIDTH times HEIGHT is {count}')
    notes = []
    view = words.get('VIEWPOINT', [])
    if view and [float(v) if re.fullmatch(r'[-+.\deE]+', v) else np.nan for v in view] != UPRIGHT:
        notes.append(
            f'VIEWPOINT ({" ".join(view)[:60]}) is not applied: points are taken as they stand'
        )
    header = _Header(names, kinds, counts, count, data, notes)
    if not 0 < header.size <= WIDEST or min(counts) < 1:
        raise ValueError(f'COUNT: points of {header.size} bytes')
    return header


def _whole(words: dict[str, list[str]], entry: str) -> list[int]:
    for word in words[entry]:
        if not re.fullmatch(r'\d{1,18}', word):
            raise ValueError(f"{entry}: '{shown(word)}' is no whole number")
    return [int(w) for w in words[entry]]


def _ascii(h: _Header, body: bytes, wanted: list[int]) -> np.ndarray:
    first = np.concatenate([[0], np.cumsum(h.counts)]).astype(int)
    lines = [line for line in re.split(r'[\r\n]+', body.decode('ascii', 'replace')) if line.strip()]
    if len(lines) != h.points:
        raise ValueError(
            f'truncated or damaged: {h.points} points are announced, {len(lines)} are there'
        )
    values = rows_of_numbers(lines)
    if values.shape[1] != first[-1]:
        raise ValueError(f'a point has {values.shape[1]} numbers, FIELDS names {first[-1]}')
    return values[:, first[wanted]]


def _announced(h: _Header, size: int) -> None:
    if size < h.points * h.size:
        raise ValueError(
            f'truncated: {h.points} points of {h.size} bytes are announced, {size} bytes are there'
        )
    if size > h.points * h.size:
        h.notes.append(f'{size - h.points * h.size} bytes behind the last point are not read')


def _binary(h: _Header, body: bytes, wanted: list[int]) -> np.ndarray:
    _announced(h, len(body))
    fields = zip(h.kinds, h.counts, strict=True)
    layout = np.dtype([(f'f{i}', kind, (count,)) for i, (kind, count) in enumerate(fields)])
    rows = np.frombuffer(body, layout, h.points)
    return np.column_stack([rows[f'f{i}'][:, 0] for i in wanted]).astype(float)


def _compressed(h: _Header, body: bytes, wanted: list[int]) -> np.ndarray:
    """All of the first field, then all of the second ..."""
    if len(body) < 8:
        raise ValueError('truncated: the sizes of the compressed data are missing')
    packed, full = (int(v) for v in np.frombuffer(body, '<u4', 2))
    if full != h.points * h.size:
        raise ValueError(
            f'{h.points} points of {h.size} bytes are announced, the compressed data hold {full} bytes'
        )
    if len(body) - 8 < packed or full > LARGEST_RATIO * packed:
        raise ValueError(
            f'truncated or damaged: {packed} compressed bytes for {full} are announced, {len(body) - 8} are there'
        )
    raw = unpacked(body[8 : 8 + packed], full)
    each = [np.dtype(k).itemsize * c * h.points for k, c in zip(h.kinds, h.counts, strict=True)]
    first = np.concatenate([[0], np.cumsum(each)]).astype(int)
    columns = [np.frombuffer(raw, h.kinds[i], h.points, int(first[i])) for i in wanted]
    return np.column_stack(columns).astype(float)


def unpacked(data: bytes, size: int) -> bytes:
    """LZF: a byte below 32 begins a run of up to 32 bytes, others name a length and how far back to copy from.

    size: of the result. ValueError where the data do not make so many bytes.
    """
    out, at = bytearray(), 0
    try:
        while at < len(data) and len(out) <= size:
            head = data[at]
            if head < 32:
                out += data[at + 1 : at + 2 + head]
                at += 2 + head
                continue
            length, at = head >> 5, at + 1
            if length == 7:
                length, at = length + data[at], at + 1
            back = ((head & 31) << 8) + data[at] + 1
            at += 1
            length += 2
            if back > len(out):
                raise ValueError(
                    'the compressed data are damaged: they point before their beginning'
                )
            piece = out[-back : len(out) - back + length] if back > length else out[-back:]
            out += (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        raise ValueError('the compressed data are truncated') from None
    if len(out) != size:
        raise ValueError(f'the compressed data make {len(out)} bytes, {size} are announced')
    return bytes(out)
