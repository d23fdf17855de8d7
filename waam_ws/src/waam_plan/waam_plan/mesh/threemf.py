"""3MF: a ZIP with an XML model inside; enough of it to get the triangles of what is to be built."""

from __future__ import annotations

import io
import zipfile
import zlib
from xml.etree import ElementTree

import numpy as np

UNITS = {'micron': 1e-6, 'millimeter': 1e-3, 'centimeter': 1e-2, 'inch': 0.0254, 'foot': 0.3048}
UNITS['meter'] = 1.0
LARGEST = 1_000_000_000  # bytes of XML
DEEPEST = 16  # components in components
MOST = 10_000_000  # triangles

Mesh = tuple[np.ndarray, np.ndarray]  # vertices (n, 3), faces (m, 3)


def read_3mf(data: bytes) -> Mesh:
    """Vertices in m and faces of all items of the build. ValueError says what is wrong."""
    root = _model(data)
    unit = root.get('unit', 'millimeter')
    if unit not in UNITS:
        raise ValueError(f'the unit {unit!r} is unknown')
    objects = {o.get('id'): o for o in _all(root, 'object')}
    meshes: list[Mesh] = []
    for item in _all(root, 'item'):
        _collect(objects, item.get('objectid'), _matrix(item.get('transform')), meshes, 0)
    if not meshes:
        raise ValueError('the build holds no object with a mesh')
    first = np.cumsum([0, *(len(v) for v, _ in meshes)])
    vertices = np.concatenate([v for v, _ in meshes]) * UNITS[unit]
    return vertices, np.concatenate([f + k for (_, f), k in zip(meshes, first, strict=False)])


def _model(data: bytes) -> ElementTree.Element:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as z:
            names = [n for n in z.namelist() if n.lower().endswith('.model')]
            if not names:
                raise ValueError('there is no .model in the archive')
            name = min(names, key=lambda n: (n.lower() != '3d/3dmodel.model', n))
            if z.getinfo(name).file_size > LARGEST:
                raise ValueError(f'{name} is larger than {LARGEST // 1_000_000} MB')
            with z.open(name) as f:
                text = f.read(LARGEST + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f'not a readable archive ({error})') from error
    if b'<!DOCTYPE' in text or b'<!ENTITY' in text:
        raise ValueError('the model declares a document type; 3MF has none')
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f'{name} is not readable XML ({error})') from error


def _all(element: ElementTree.Element, tag: str) -> list[ElementTree.Element]:
    return [e for e in element.iter() if e.tag.rsplit('}', 1)[-1] == tag]


def _matrix(text: str | None) -> np.ndarray:
    """(4, 3) of rows m00 m01 m02 ... m32; points are rows and stand to its left."""
    if not text:
        return np.vstack([np.eye(3), np.zeros(3)])
    values = [float(v) for v in text.split()]
    if len(values) != 12:
        raise ValueError(f'a transform of {len(values)} numbers, 12 are needed')
    return np.array(values).reshape(4, 3)


def _collect(
    objects: dict, number: str | None, at: np.ndarray, out: list[Mesh], depth: int
) -> None:
    """Meshes of an object and of its components, placed."""
    if depth > DEEPEST:
        raise ValueError('components refer to each other without end')
    if number not in objects:
        raise ValueError(f'object {number} is referred to, but not there')
    for component in _all(objects[number], 'component'):
        inner = _matrix(component.get('transform'))
        both = np.vstack([inner[:3] @ at[:3], inner[3] @ at[:3] + at[3]])
        _collect(objects, component.get('objectid'), both, out, depth + 1)
    vertices = [[float(v.get(a, '')) for a in 'xyz'] for v in _all(objects[number], 'vertex')]
    faces = [
        [int(t.get(a, '')) for a in ('v1', 'v2', 'v3')] for t in _all(objects[number], 'triangle')
    ]
    if not faces:
        return
    points, corners = np.array(vertices, float).reshape(-1, 3), np.array(faces)
    if corners.min() < 0 or corners.max() >= len(points):
        raise ValueError(f'object {number}: a triangle refers to a vertex that is not there')
    if sum(len(f) for _, f in out) + len(corners) > MOST:
        raise ValueError(f'more than {MOST} triangles')
    out.append((points @ at[:3] + at[3], corners))
