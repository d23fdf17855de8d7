"""One model part of a 3MF package: objects, components and the items of the build, read in one pass."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from waam_plan.mesh.package import parse
from waam_plan.texts import shown, why_no_number

CORE = 'http://schemas.microsoft.com/3dmanufacturing/core/2015/02'
PRODUCTION = 'http://schemas.microsoft.com/3dmanufacturing/production/2015/06'
HARMLESS = {  # extensions that change no shape
    CORE,
    PRODUCTION,
    'http://schemas.microsoft.com/3dmanufacturing/material/2015/02',
    'http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07',
}
IN_OBJECT = {'mesh', 'components', 'metadatagroup'}
IN_MESH = {'vertices', 'triangles', 'trianglesets'}
NO_METAL = {'support', 'solidsupport', 'surface', 'other'}  # types of objects that are not built
CURA = re.compile(r'cura:(anti_overhang_mesh|support_mesh|infill_mesh|cutting_mesh)')
_NUMBER = re.compile(r'\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*', re.ASCII)


@dataclass(frozen=True)
class Use:
    """An item or a component. at: (4, 3), rows m00 m01 m02 ... m32; points are rows and stand to its left."""

    object: str
    path: str  # of another part, '' = the same
    at: np.ndarray
    printable: bool = True


@dataclass
class Object:
    """left_out: why it is no metal, '' = it is. vertices: (n, 3) in units of the model; faces: (m, 3)."""

    left_out: str = ''
    components: list[Use] = field(default_factory=list)
    vertices: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int64))


@dataclass
class Model:
    """objects: by id."""

    unit: str = 'millimeter'
    objects: dict[str, Object] = field(default_factory=dict)
    items: list[Use] = field(default_factory=list)


def read_model(text: Iterable[bytes], part: str) -> Model:
    """ValueError names part, line, object and fault."""
    reader = _Reader()
    parse(text, part, reader.begin, reader.close, reader.text, reader.prefixes)
    if not reader.found:
        raise ValueError(f'{part} holds no model')
    return reader.model


class _Reader:
    """Handlers of the XML parser."""

    def __init__(self) -> None:
        self.model, self.found = Model(), False
        self.prefixes: dict[str, str] = {}
        self.path: list[str] = []
        self.id, self.object = '', Object()
        self.points, self.corners = array('d'), array('q')
        self.cura = self.said = ''

    def begin(self, tag: str, attributes: dict[str, str]) -> None:
        space, _, name = tag.rpartition(' ')
        parent = self.path[-1] if self.path else ''
        self.path.append(name)
        if name == 'vertex' and parent == 'vertices':
            self.points.extend([self._number(attributes, a) for a in 'xyz'])
        elif name == 'triangle' and parent == 'triangles':
            self.corners.extend([self._index(attributes, a) for a in ('v1', 'v2', 'v3')])
        elif parent == 'object' and name not in IN_OBJECT:
            raise ValueError(
                f"object {self.id} is a {shown(name)}, which is not read; save it as a mesh"
            )
        elif parent == 'mesh' and name not in IN_MESH:
            raise ValueError(
                f"object {self.id}: its mesh has {shown(name)}, which is not read; save it as triangles"
            )
        elif name == 'model' and not parent:
            self._model(attributes)
        elif name == 'object' and parent == 'resources':
            self._object(attributes)
        elif name == 'component' and parent == 'components':
            self.object.components.append(self._use(attributes))
        elif name == 'item' and parent == 'build':
            self.model.items.append(self._use(attributes))
        elif name == 'metadata' and CURA.fullmatch(attributes.get('name', '')):
            self.cura, self.said = attributes['name'], ''

    def text(self, data: str) -> None:
        if self.cura:
            self.said += data

    def close(self, tag: str) -> None:
        self.path.pop()
        if self.cura and self.said.strip().lower() != 'false':
            self.object.left_out = f'the slicer ({self.cura})'
        self.cura = ''
        if tag.rpartition(' ')[2] == 'object' and self.path and self.path[-1] == 'resources':
            self._finish()

    def _model(self, attributes: dict[str, str]) -> None:
        self.found = True
        self.model.unit = attributes.get('unit', 'millimeter')
        for prefix in attributes.get('requiredextensions', '').split():
            uri = self.prefixes.get(prefix, prefix)
            if uri not in HARMLESS:
                raise ValueError(
                    f"the model requires the extension {shown(prefix)} ({uri[-40:]}), which is not read; export it "
                    'without'
                )

    def _object(self, attributes: dict[str, str]) -> None:
        self.id = attributes.get('id', '')
        if self.id in self.model.objects:
            raise ValueError(f'object {shown(self.id)} is there twice')
        kind = attributes.get('type', 'model')
        if kind != 'model' and kind not in NO_METAL:
            raise ValueError(f"object {self.id}: its type '{shown(kind)}' is not known")
        self.object = Object('' if kind == 'model' else f'type {kind}')
        self.points, self.corners = array('d'), array('q')

    def _finish(self) -> None:
        points = np.array(self.points, float).reshape(-1, 3)
        corners = np.array(self.corners, np.int64).reshape(-1, 3)
        if len(corners) and (corners.min() < 0 or corners.max() >= len(points)):
            raise ValueError(f'object {self.id}: a triangle refers to a vertex that is not there')
        self.object.vertices, self.object.faces = points, corners
        self.model.objects[self.id] = self.object
        self.id, self.object = '', Object()

    def _number(self, attributes: dict[str, str], name: str) -> float:
        word = attributes.get(name, '')
        if not _NUMBER.fullmatch(word):
            n = len(self.points) // 3
            raise ValueError(f'object {self.id}, vertex {n}: {name}: {why_no_number(word)}')
        return float(word)

    def _index(self, attributes: dict[str, str], name: str) -> int:
        word = attributes.get(name, '').strip()
        if not re.fullmatch(r'\d{1,12}', word, re.ASCII):
            n = len(self.corners) // 3
            raise ValueError(
                f"object {self.id}, triangle {n}: {name}: '{shown(word)}' is no vertex"
            )
        return int(word)

    def _use(self, attributes: dict[str, str]) -> Use:
        number = attributes.get('objectid', '')
        said = attributes.get('printable', '1').strip().lower()
        if said not in ('0', '1', 'true', 'false'):
            raise ValueError(f"item of object {number}: printable is '{shown(said)}'")
        at = _matrix(attributes.get('transform'), f'the transform of object {number}')
        path = attributes.get(f'{PRODUCTION} path', '')
        return Use(number, path, at, said in ('1', 'true'))


def _matrix(text: str | None, where: str) -> np.ndarray:
    """(4, 3)"""
    if not text:
        return np.vstack([np.eye(3), np.zeros(3)])
    words = text.split()
    for word in words:
        if not _NUMBER.fullmatch(word):
            raise ValueError(f'{where}: {why_no_number(word)}')
    if len(words) != 12:
        raise ValueError(f'{where} has {len(words)} numbers, 12 are needed')
    return np.array([float(w) for w in words]).reshape(4, 3)
