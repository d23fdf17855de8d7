"""STL, text and binary, read strictly: what lies between two facets and is no STL is refused with its line."""

from __future__ import annotations

import re
from array import array

import numpy as np

from waam_plan.texts import decimal_comma, shown, text_of

HEADER, FACET = 84, 50  # bytes
BEHIND = 1024  # bytes that may follow the last triangle of a binary file
_REAL = r'(\S+)\s+(\S+)\s+(\S+)\s+'
_TEXT_FACET = re.compile(
    r'\s*facet\s+(?:normal\s+\S+\s+\S+\s+\S+\s+)?outer\s+loop\s+'
    + 3 * f'vertex\\s+{_REAL}'
    + r'endloop\s+end\s?facet(?=\s|$)',
    re.IGNORECASE,
)
_FRAME = re.compile(r'\s*(?:(solid)|(end\s?solid))(?=\s|$)[^\n]*', re.IGNORECASE)
_KIND = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('extra', '<u2')])


def read_stl(data: bytes) -> tuple[np.ndarray, list[str]]:
    """Corners (n, 3, 3) in units of the file, and notes for a person. ValueError says what is wrong, and where."""
    count = int.from_bytes(data[80:84], 'little')
    exact = len(data) == HEADER + FACET * count >= HEADER + FACET
    if exact or not _is_text(data):
        return _binary(data, count)
    return _text(text_of(data))


def stl_of(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> bytes:
    """Binary STL of heights z (rows, cols) at x (cols), y (rows), all in units of the file; open where z is NaN."""
    points = np.stack([*np.meshgrid(x, y), z], axis=2).astype('<f4')
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    corners = np.concatenate(
        [np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))]
    )
    facets = np.zeros(int(np.isfinite(corners).all(axis=(1, 2)).sum()), _KIND)
    facets['corners'] = kept = corners[np.isfinite(corners).all(axis=(1, 2))]
    normal = np.cross(kept[:, 1] - kept[:, 0], kept[:, 2] - kept[:, 0])
    facets['normal'] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    return bytes(80) + len(facets).to_bytes(4, 'little') + facets.tobytes()


def _is_text(data: bytes) -> bool:
    """Text begins with 'solid' and holds no zero bytes; many binary files begin with 'solid', too."""
    head = text_of(data[:2048])
    return head.lstrip().lower().startswith('solid') and '\0' not in head


def _binary(data: bytes, count: int) -> tuple[np.ndarray, list[str]]:
    if len(data) < HEADER:
        raise ValueError(f'{len(data)} bytes are too few for an STL file; it is truncated')
    want = HEADER + FACET * count
    said = f'the header announces {count} triangles = {want} bytes, the file has {len(data)}'
    if len(data) < want:
        raise ValueError(f'truncated or corrupt STL: {said}; copy or export it again')
    if len(data) > want + BEHIND:
        raise ValueError(f'corrupt STL: {said}; export it again')
    if count == 0:
        raise ValueError('empty mesh, the header announces 0 triangles')
    notes = []
    if len(data) > want:
        notes.append(f'{len(data) - want} bytes behind the last triangle are not read')
    return np.frombuffer(data, _KIND, count, HEADER)['corners'].astype(float), notes


def _text(text: str) -> tuple[np.ndarray, list[str]]:
    values, at, solids, inside = array('d'), 0, 0, False
    while True:
        if found := _TEXT_FACET.match(text, at):
            try:
                values.extend(map(float, found.groups()))
            except ValueError:
                raise _no_number(text, found) from None
        elif found := _FRAME.match(text, at):
            solids += bool(found[1])
            inside = bool(found[1])
        else:
            break
        at = found.end()
    if text[at:].strip():
        raise _no_facet(text, at)
    if inside:
        raise ValueError(
            'truncated text STL, there is no "endsolid" at its end; copy or export it again'
        )
    if not values:
        raise ValueError('empty mesh, the file holds no triangle')
    notes = [f'{solids} solids in one file, all are taken'] if solids > 1 else []
    return np.frombuffer(values, float).reshape(-1, 3, 3), notes


def _line(text: str, at: int) -> int:
    return text.count('\n', 0, at) + 1


def _no_number(text: str, found: re.Match[str]) -> ValueError:
    for i, word in enumerate(found.groups(), 1):
        try:
            float(word)
        except ValueError:
            comma = (
                ' has a decimal comma; export with decimal points' if decimal_comma(word) else ''
            )
            why = comma or ' is no number'
            return ValueError(f"line {_line(text, found.start(i))}: '{shown(word)}'{why}")
    raise AssertionError('all of them are numbers')


def _no_facet(text: str, at: int) -> ValueError:
    """At `at` begins no facet: cut off, or something else."""
    at += len(text[at:]) - len(text[at:].lstrip())
    line = _line(text, at)
    rest = text[at : at + 2000]
    if re.match(r'facet\b', rest, re.IGNORECASE):
        if not re.search(r'end\s?facet', rest, re.IGNORECASE):
            return ValueError(
                f'truncated text STL: the facet of line {line} is not closed; copy or export it again'
            )
        corners = len(re.findall('vertex', rest.lower().partition('endfacet')[0]))
        return ValueError(f'line {line}: this facet has {corners} corners or unknown words')
    return ValueError(f"line {line}: '{shown(rest)}' is no facet of a text STL")
