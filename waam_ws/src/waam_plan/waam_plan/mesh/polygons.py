"""OBJ and OFF: corners and faces in text. Faces of more than three corners must be convex, so that fans of triangles
are the same face."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator

import numpy as np

from waam_plan.texts import numbered_lines, shown, why_no_number

LOOKS = {'vt', 'vn', 'vp', 'g', 'o', 's', 'usemtl', 'mtllib', 'maplib', 'usemap', 'mg', 'lod', 'bevel',
         'c_interp', 'd_interp', 'shadow_obj', 'trace_obj'}  # fmt: skip
NO_FACES = {'l': 'lines', 'p': 'points'}  # of an OBJ, which have no area
BENT = 1e-6  # share of the longest edges' area that a convex corner may turn back
_NUMBER = re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)', re.ASCII | re.I)
Mesh = tuple[np.ndarray, np.ndarray, list[str]]  # vertices (n, 3), faces (m, 3), notes


MAX_LINE_LENGTH = 100_000  # characters of a line


class _Maker:
    """Collects corners and faces."""

    def __init__(self) -> None:
        self.points, self.faces = array('d'), array('q')
        self.polygons: list[tuple[int, list[int]]] = []  # line, corners: more than three

    @property
    def count(self) -> int:
        return len(self.points) // 3

    def vertex(self, line: int, words: list[str]) -> None:
        if len(words) < 3:
            raise ValueError(f'line {line}: a vertex of {len(words)} numbers')
        for word in words[:3]:
            if not _NUMBER.fullmatch(word):
                raise ValueError(f'line {line}: {why_no_number(word)}')
            self.points.append(float(word))

    def face(self, line: int, corners: list[int]) -> None:
        if len(corners) < 3:
            raise ValueError(f'line {line}: a face of {len(corners)} corners')
        for corner in corners:
            if not 0 <= corner < self.count:
                raise ValueError(
                    f'line {line}: corner {corner + 1} is not there, there are {self.count}'
                )
        for i in range(1, len(corners) - 1):
            self.faces.extend((corners[0], corners[i], corners[i + 1]))
        if len(corners) > 3:
            self.polygons.append((line, corners))

    def mesh(self, notes: list[str]) -> Mesh:
        vertices = np.array(self.points).reshape(-1, 3)
        for line, corners in self.polygons:
            if not _convex(vertices[corners]):
                raise ValueError(
                    f'line {line}: a face of {len(corners)} corners is not convex; export triangles'
                )
        return vertices, np.array(self.faces, np.int64).reshape(-1, 3), notes


def _convex(corners: np.ndarray) -> bool:
    edges = np.roll(corners, -1, axis=0) - corners
    turns = np.cross(edges, np.roll(edges, -1, axis=0))
    normal = np.cross(corners[:-1] - corners[0], corners[1:] - corners[0]).sum(axis=0)
    size = np.linalg.norm(normal)
    longest = float((edges**2).sum(axis=1).max())
    return bool(size == 0 or (turns @ normal / size >= -BENT * longest).all())


def _words(text: str) -> Iterator[tuple[int, list[str]]]:
    for number, line in numbered_lines(text):
        if len(line) > MAX_LINE_LENGTH:
            raise ValueError(f'line {number}: {len(line)} characters, {MAX_LINE_LENGTH} at most')
        if words := line.partition('#')[0].split():
            yield number, words


def read_obj(text: str) -> Mesh:
    """ValueError names the line."""
    made, left = _Maker(), dict.fromkeys(NO_FACES, 0)
    for line, words in _words(text.replace('\\\n', ' ')):
        kind, rest = words[0], words[1:]
        if kind == 'v':
            made.vertex(line, rest)
        elif kind == 'f':
            made.face(line, [_corner(line, word, made.count) for word in rest])
        elif kind in NO_FACES:
            left[kind] += 1
        elif kind not in LOOKS:
            raise ValueError(
                f"line {line}: '{shown(kind)}' is not read; export the part as triangles"
            )
    return made.mesh([f'left out: {n} {NO_FACES[k]} of the file' for k, n in left.items() if n])


def _corner(line: int, word: str, count: int) -> int:
    """From 0; negative ones count back from the last vertex."""
    number = word.partition('/')[0]
    if not re.fullmatch(r'-?\d{1,12}', number, re.ASCII) or int(number) == 0:
        raise ValueError(f"line {line}: '{shown(word)}' is no corner")
    return int(number) - 1 if int(number) > 0 else count + int(number)


def read_off(text: str) -> Mesh:
    """ValueError names the line."""
    rows = _words(text)
    line, words = next(rows, (0, ['']))
    if not re.fullmatch(r'(ST|C|N)*OFF', words[0]):
        raise ValueError("it does not begin with 'OFF'")
    counts = words[1:] or next(rows, (0, []))[1]
    if len(counts) < 2 or not all(re.fullmatch(r'\d{1,12}', w) for w in counts):
        raise ValueError('the numbers of vertices and faces are missing')
    vertices, faces = int(counts[0]), int(counts[1])
    made, found = _Maker(), 0
    for found, (line, words) in enumerate(rows, 1):
        if found <= vertices:
            made.vertex(line, words)
        elif found <= vertices + faces:
            made.face(line, _off_face(line, words))
    if found != vertices + faces:
        raise ValueError(
            f'truncated or damaged: {vertices} vertices and {faces} faces are announced, {found} lines are there'
        )
    return made.mesh([])


def _off_face(line: int, words: list[str]) -> list[int]:
    count = int(words[0]) if re.fullmatch(r'\d{1,6}', words[0]) else -1
    corners = words[1 : count + 1]
    if not 0 < count < len(words) or not all(re.fullmatch(r'\d{1,12}', w) for w in corners):
        raise ValueError(f"line {line}: '{shown(' '.join(words[:20]))}' is no face")
    return [int(w) for w in corners]
