"""PLY: its header, checked before anything is made for it, and the points of its vertices."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from waam_plan.mesh.text_cloud import INTENSITIES, Table
from waam_plan.texts import rows_of_numbers, shown

TYPES = {
    'char': 'i1', 'int8': 'i1', 'uchar': 'u1', 'uint8': 'u1', 'short': 'i2', 'int16': 'i2', 'ushort': 'u2',
    'uint16': 'u2', 'int': 'i4', 'int32': 'i4', 'uint': 'u4', 'uint32': 'u4', 'float': 'f4', 'float32': 'f4',
    'double': 'f8', 'float64': 'f8',
}  # fmt: skip
FORMATS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}
HEAD = 65536  # bytes in which the header ends


@dataclass
class Element:
    """kinds: of the properties, numpy without byte order; '' = a list."""

    name: str
    count: int
    names: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)

    @property
    def least(self) -> int:
        """Bytes that one takes at least in a binary file."""
        return sum(np.dtype(k).itemsize if k else 1 for k in self.kinds)


@dataclass(frozen=True)
class Header:
    """order: '<', '>' or '' for text. end: where the data begin."""

    order: str
    elements: list[Element]
    end: int

    def count(self, name: str) -> int:
        """How many of an element there are."""
        return sum(e.count for e in self.elements if e.name == name)


def read_header(data: bytes) -> Header:
    """ValueError names the line, or the element of which more are announced than the file can hold."""
    found = re.search(rb'\r?(?:\n|\r)end_header[ \t]*(?:\r\n|\n|\r)', data[:HEAD])
    if not data.startswith(b'ply') or not found:
        raise ValueError('it does not begin with a PLY header (ply ... end_header)')
    elements: list[Element] = []
    order = None
    for line in re.split(r'\r\n|\n|\r', data[: found.start()].decode('ascii', 'replace'))[1:]:
        words = line.split()
        if not words or words[0] in ('comment', 'obj_info'):
            continue
        if words[0] == 'format' and len(words) == 3 and words[1] in FORMATS:
            order = FORMATS[words[1]]
        elif words[0] == 'element' and len(words) == 3 and re.fullmatch(r'\d{1,18}', words[2]):
            elements.append(Element(words[1], int(words[2])))
        elif words[0] == 'property' and elements and _property(elements[-1], words[1:]):
            continue
        else:
            raise ValueError(f"the line '{shown(line)}' of the header is not known")
    if order is None:
        raise ValueError('the header says no format')
    header = Header(order, elements, found.end())
    rest = len(data) - header.end
    for e in elements:
        least = e.least if order else 2 * max(1, len(e.kinds)) - 1
        if e.count * max(1, least) > rest + 1:
            raise ValueError(
                f'truncated or damaged: element {e.name}: {e.count} are announced, {rest} bytes are there'
            )
    return header


def _property(element: Element, words: list[str]) -> bool:
    known = len(words) == 2 and words[0] in TYPES
    listed = len(words) == 4 and words[0] == 'list' and words[1] in TYPES and words[2] in TYPES
    if known or listed:
        element.names.append(words[-1])
        element.kinds.append(TYPES[words[0]] if known else '')
    return known or listed


def is_points(data: bytes) -> bool:
    """Whether a PLY file has no faces."""
    found = re.search(rb'element\s+face\s+(\d+)', data[:HEAD].partition(b'end_header')[0])
    return data.startswith(b'ply') and (found is None or int(found[1]) == 0)


def read_points(data: bytes) -> Table:
    """The vertices. ValueError names what is missing or damaged."""
    h = read_header(data)
    if not h.elements or h.elements[0].name != 'vertex':
        raise ValueError('the first element is not the vertex')
    e = h.elements[0]
    for axis in 'xyz':
        if e.names.count(axis) != 1:
            raise ValueError(
                f'the vertex has the properties {", ".join(e.names)[:60]}: {axis} is needed'
            )
    if not all(e.kinds):
        raise ValueError('the vertex has a property that is a list')
    lower = [n.lower() for n in e.names]
    wanted = [e.names.index(a) for a in 'xyz']
    wanted += [lower.index(n) for n in (*INTENSITIES, 'scalar_intensity') if n in lower][:1]
    values = _binary(h, e, data, wanted) if h.order else _ascii(h, e, data, wanted)
    return Table(values[:, :3], values[:, 3] if len(wanted) > 3 else None)


def _binary(h: Header, e: Element, data: bytes, wanted: list[int]) -> np.ndarray:
    layout = np.dtype([(f'f{i}', h.order + kind) for i, kind in enumerate(e.kinds)])
    if len(data) - h.end < e.count * layout.itemsize:
        raise ValueError(f'truncated: {e.count} vertices are announced')
    rows = np.frombuffer(data, layout, e.count, h.end)
    return np.column_stack([rows[f'f{i}'] for i in wanted]).astype(float)


def _ascii(h: Header, e: Element, data: bytes, wanted: list[int]) -> np.ndarray:
    lines = re.split(r'[\r\n]+', data[h.end :].decode('ascii', 'replace'))
    lines = [line for line in lines if line.strip()][: e.count]
    if len(lines) < e.count:
        raise ValueError(f'truncated: {e.count} vertices are announced, {len(lines)} are there')
    if not lines:
        return np.zeros((0, len(wanted)))
    values = rows_of_numbers(lines)
    if values.shape[1] != len(e.kinds):
        raise ValueError(f'a vertex has {values.shape[1]} numbers, the header says {len(e.kinds)}')
    return values[:, wanted]
