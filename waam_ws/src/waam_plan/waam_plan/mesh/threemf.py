"""3MF: the triangles of what is to be built. What is not understood is refused, what is left out is counted.

Core specification 1.3 and the production extension (models in several parts); materials and colours mean nothing here.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from waam_plan.mesh.model_part import Model, Object, Use, read_model
from waam_plan.mesh.package import Package, part_name
from waam_plan.mesh.slicer_parts import Pieces, pieces_of

UNITS = {'micron': 1e-6, 'millimeter': 1e-3, 'centimeter': 1e-2, 'inch': 0.0254, 'foot': 0.3048}
UNITS['meter'] = 1.0
MAX_VISITS = 20_000  # of objects, by items and components
MAX_TRIANGLES = 10_000_000  # triangles

Key = tuple[str, str]  # part, id of an object


def read_3mf(data: bytes) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Vertices (n, 3) in m and faces (m, 3) of all items of the build, and what was left out. ValueError says what is
    wrong, and where."""
    return _Build(Package(data)).mesh()


class _Build:
    """The objects of all parts that the build refers to."""

    def __init__(self, package: Package) -> None:
        self.package = package
        self.start = package.start()
        self.models: dict[str, Model] = {}
        self.pieces: Pieces = pieces_of(package)
        self.out: list[tuple[np.ndarray, np.ndarray]] = []
        self.left_out: Counter[str] = Counter()

    def model(self, part: str) -> Model:
        """Of a part, read once."""
        if part not in self.models:
            self.models[part] = model = read_model(self.package.chunks(part), part)
            if model.unit not in UNITS:
                raise ValueError(f'the unit {model.unit!r} is unknown')
            if part != self.start and model.unit != self.models[self.start].unit:
                raise ValueError(f'{part} counts in {model.unit}, {self.start} in another unit')
        return self.models[part]

    def object(self, key: Key) -> Object:
        """ValueError where it is not there."""
        part, number = key
        found = self.model(part).objects.get(number)
        if found is None:
            raise ValueError(f'object {number} of {part} is referred to, but not there')
        return found

    def key(self, use: Use, part: str) -> Key:
        """Which object an item or a component of `part` refers to."""
        return (part_name(use.path, part) if use.path else part), use.object

    def mesh(self) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """See `read_3mf`."""
        model = self.model(self.start)
        if not model.items:
            raise ValueError('the build is empty; place the part on the plate and export again')
        items = [i for i in model.items if i.printable]
        self.left_out['items that are switched off (printable="0")'] += len(model.items) - len(
            items
        )
        self._count([self.key(i, self.start) for i in items])
        for item in items:
            self._collect(self.key(item, self.start), item.at)
        said = [f'left out: {count} {what}' for what, count in self.left_out.items() if count]
        if not self.out:
            raise ValueError(
                f'the build holds no object with a mesh{"".join(f"; {s}" for s in said)}'
            )
        first = np.cumsum([0, *(len(v) for v, _ in self.out)])
        vertices = np.concatenate([v for v, _ in self.out]) * UNITS[model.unit]
        return (
            vertices,
            np.concatenate([f + k for (_, f), k in zip(self.out, first, strict=False)]),
            said,
        )

    def _count(self, items: list[Key]) -> None:
        """ValueError for components in a circle, and for too many visits or triangles, before any is made."""
        visits: dict[Key, int] = {}
        faces: dict[Key, int] = {}
        open_: set[Key] = set()
        todo = [(key, False) for key in items]
        while todo:
            key, done = todo.pop()
            if done:
                inner = [self.key(c, key[0]) for c in self.object(key).components]
                visits[key] = 1 + sum(visits[k] for k in inner)
                faces[key] = len(self.object(key).faces) + sum(faces[k] for k in inner)
                open_.discard(key)
            elif key in open_:
                raise ValueError(f'object {key[1]} of {key[0]} is a component of itself')
            elif key not in visits:
                open_.add(key)
                todo.append((key, True))
                todo += [(self.key(c, key[0]), False) for c in self.object(key).components]
            if len(open_) > MAX_VISITS:
                raise ValueError('components refer to each other without end')
        if sum(visits[k] for k in items) > MAX_VISITS:
            count = sum(visits[k] for k in items)
            raise ValueError(
                f'components of components make {count:.3g} objects, more than {MAX_VISITS} are not built'
            )
        if sum(faces[k] for k in items) > MAX_TRIANGLES:
            raise ValueError(f'more than {MAX_TRIANGLES} triangles')

    def _collect(self, key: Key, at: np.ndarray) -> None:
        """Meshes of an object and of its components, placed; at: (4, 3)."""
        todo = [(key, at)]
        while todo:
            key, at = todo.pop()
            found = self.object(key)
            if found.left_out:
                self.left_out[f'objects of {found.left_out}'] += 1
                continue
            for component in found.components:
                inner = self.key(component, key[0])
                piece = self.pieces.components.get((key[1], component.object))
                if piece and key[0] == self.start and (what := piece.left_out):
                    self.left_out[f'volumes of the slicer: {what}'] += 1
                    continue
                a = component.at
                todo.append((inner, np.vstack([a[:3] @ at[:3], a[3] @ at[:3] + at[3]])))
            if len(found.faces):
                self._add(key, found, at)

    def _add(self, key: Key, found: Object, at: np.ndarray) -> None:
        keep = np.ones(len(found.faces), bool)
        for piece in self.pieces.ranges.get(key[1], []) if key[0] == self.start else []:
            if piece.last >= len(keep) or piece.first > piece.last:
                raise ValueError(
                    f'object {key[1]}: a volume of the slicer has the triangles {piece.first} to {piece.last}, there '
                    f'are {len(keep)}'
                )
            if what := piece.left_out:
                self.left_out[f'volumes of the slicer: {what}'] += 1
                keep[piece.first : piece.last + 1] = False
        faces = found.faces[keep]
        size = np.linalg.det(at[:3])
        if abs(size) < 1e-12:
            raise ValueError(f'object {key[1]}: its transform makes it flat')
        if size < 0:  # a reflection turns the faces inside out
            faces = faces[:, ::-1]
        if len(faces):
            self.out.append((found.vertices @ at[:3] + at[3], faces))
