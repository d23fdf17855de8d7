"""Parts to try a cell on, as nominal and as-found meshes: what workshops restore and build, with edges all around.

    python3 -m waam_lab.parts FOLDER

Every part is a height field over a grid of quadrangles that may bend, so outlines are exact: rectangles stay
rectangles, circles are polygons of 180 sides. All in mm; the lower corner lies at the origin.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from .job import LabJob, build, restore

STEP = 1.0  # mm, of the grids
SIDES = 180  # of a circle


@dataclass(frozen=True)
class Shape:
    """A body on a floor at z = 0 (mm).

    plan: (m, n, 2) corners of the grid; kept: (m - 1, n - 1) quadrangles with metal; nominal, worn: (m, n) heights;
    worn None: built from nothing."""

    plan: np.ndarray
    kept: np.ndarray
    nominal: np.ndarray
    worn: np.ndarray | None = None

    def meshes(self) -> tuple[trimesh.Trimesh, trimesh.Trimesh | None]:
        """Nominal and as found, closed."""
        found = None if self.worn is None else body(self.plan, self.kept, self.worn)
        return body(self.plan, self.kept, self.nominal), found


def body(plan: np.ndarray, kept: np.ndarray, top: np.ndarray) -> trimesh.Trimesh:
    """Closed mesh between the floor and a height field. Shapes as of Shape."""
    m, n = top.shape
    upper = np.concatenate([plan, top[..., None]], axis=2).reshape(-1, 3)
    lower = upper * (1.0, 1.0, 0.0)
    index = np.arange(m * n).reshape(m, n)
    corners = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    quads = np.stack(
        [c[kept] for c in corners], axis=1
    )  # first index runs along x: counter-clockwise
    flat = [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    edges = np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)])
    points = np.round(upper[:, :2], 6)
    _, same = np.unique(points, axis=0, return_inverse=True)
    a, b = same.ravel()[edges].T
    inner = np.isin(a * m * n + b, b * m * n + a)  # the same edge the other way round: a neighbour
    a, b = edges[~inner & (a != b)].T
    under = m * n
    walls = [np.column_stack([a + under, b + under, b]), np.column_stack([a + under, b, a])]
    floor = [f[:, ::-1] + under for f in flat]
    mesh = trimesh.Trimesh(
        np.concatenate([upper, lower]), np.concatenate([*flat, *floor, *walls]), process=True
    )
    mesh.update_faces(mesh.nondegenerate_faces())
    return mesh


def _rectangle(length: float, width: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners of a rectangular grid (m, n, 2), and their x and y."""
    x = np.linspace(0, length, round(length / STEP) + 1)
    y = np.linspace(0, width, round(width / STEP) + 1)
    plan = np.stack(np.meshgrid(x, y, indexing='ij'), axis=2)
    return plan, plan[..., 0], plan[..., 1]


def _disc(inner: float, outer: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a polar grid between two radii (m, n, 2), and their angles (rad)."""
    r = np.linspace(inner, outer, round((outer - inner) / STEP) + 1)
    angle = np.linspace(0, 2 * np.pi, SIDES + 1)
    radius, turn = np.meshgrid(r, angle, indexing='ij')
    plan = outer + radius[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=2)
    return plan, turn


def _all(plan: np.ndarray) -> np.ndarray:
    return np.ones((plan.shape[0] - 1, plan.shape[1] - 1), bool)


def _middles(values: np.ndarray) -> np.ndarray:
    return (values[:-1, :-1] + values[1:, :-1] + values[1:, 1:] + values[:-1, 1:]) / 4


def _soft(distance: np.ndarray, width: float) -> np.ndarray:
    """0 at and below 0, 1 from `width` on, smooth between."""
    t = np.clip(distance / width, 0, 1)
    return t * t * (3 - 2 * t)


def worn_l() -> Shape:
    """Block in the shape of an L, arms 28 mm wide: the whole top is worn by 3 to 6 mm, most at the outer corner."""
    plan, x, y = _rectangle(80, 60)
    kept = (_middles(x) < 28) | (_middles(y) < 28)
    wear = 3.4 + 2.2 * np.exp(-((x / 40) ** 2) - (y / 35) ** 2)
    wear += 0.35 * np.sin(x / 9 + 0.6) * np.cos(y / 11)
    return Shape(plan, kept, np.full(x.shape, 20.0), 20.0 - wear)


def ring() -> Shape:
    """Sealing ring, 80 mm outside and 44 mm inside, worn by 3 to 5 mm around."""
    plan, turn = _disc(22, 40)
    wear = 4.0 + 0.8 * np.cos(turn - 0.7) + 0.25 * np.sin(5 * turn)
    return Shape(plan, _all(plan), np.full(turn.shape, 18.0), 18.0 - wear)


def blade() -> Shape:
    """Blade 4 mm thick, 70 mm along a bow of 90 mm radius, whose tip has lost 4 to 7 mm."""
    along = np.linspace(-35, 35, 71) / 90
    across = np.linspace(-2, 2, 9)
    angle, off = np.meshgrid(along, across, indexing='ij')
    radius = 90 - off  # across grows to the left of the way
    plan = np.stack([radius * np.sin(angle), 90 - radius * np.cos(angle)], axis=2)
    plan -= plan.reshape(-1, 2).min(axis=0)
    share = (angle - along[0]) / (along[-1] - along[0])
    wear = 4.2 + 2.3 * share**1.5 + 0.25 * np.sin(9 * share)
    return Shape(plan, _all(plan), np.full(angle.shape, 30.0), 30.0 - wear)


def cylinder() -> Shape:
    """Cylinder of 30 mm, 16 mm high, built from nothing."""
    plan, turn = _disc(0, 15)
    return Shape(plan, _all(plan), np.full(turn.shape, 16.0))


def pockets() -> Shape:
    """Plate with two worn pockets, 4.5 and 7 mm deep; in one of them an island of 14 mm stands as it was."""
    plan, x, y = _rectangle(104, 60)

    def pocket(x0: float, x1: float, depth: float) -> np.ndarray:
        inside = np.minimum.reduce([x - x0, x1 - x, y - 9, 51 - y])
        return depth * _soft(inside, 6) * (1 + 0.05 * np.sin(0.4 * x) * np.cos(0.3 * y))

    apart = np.maximum(abs(x - 73), abs(y - 30)) - 7
    wear = pocket(8, 44, 4.5) + pocket(50, 96, 7.0) * _soft(apart, 5)
    return Shape(plan, _all(plan), np.full(x.shape, 24.0), 24.0 - wear)


def flank() -> Shape:
    """Wedge whose flank of 15 degrees is worn up to both of its sides, by 2 to 6 mm; plateaus above and below it."""
    plan, x, y = _rectangle(84, 44)
    nominal = 14 + np.tan(np.radians(15)) * np.clip(x - 14, 0, 56)
    wear = 5.0 * _soft(x - 16, 14) * _soft(70 - x, 14) * (1 + 0.15 * np.sin(y / 8))
    return Shape(plan, _all(plan), nominal, nominal - wear)


def block() -> Shape:
    """Block of 60 x 40 x 60 mm, built from nothing: do its corners keep up?"""
    plan, x, _ = _rectangle(60, 40)
    return Shape(plan, _all(plan), np.full(x.shape, 60.0))


PARTS: dict[str, Callable[[], Shape]] = {
    'l': worn_l,
    'ring': ring,
    'blade': blade,
    'cylinder': cylinder,
    'pockets': pockets,
    'flank': flank,
}
BUILDS: dict[str, Callable[[], Shape]] = {'block': block}


def write(folder: Path, name: str) -> tuple[Path, Path | None]:
    """NAME_nominal.stl and NAME_worn.stl (None: a build) of a part. KeyError for a name that is none."""
    folder.mkdir(parents=True, exist_ok=True)
    nominal, worn = {**PARTS, **BUILDS}[name]().meshes()
    paths = folder / f'{name}_nominal.stl', folder / f'{name}_worn.stl'
    nominal.export(paths[0])
    if worn is None:
        return paths[0], None
    worn.export(paths[1])
    return paths


def job(folder: Path, name: str, seed: int = 1, **options: object) -> LabJob:
    """The restoration or build of a part whose meshes are written to the folder. options: as of waam_lab.restore."""
    nominal, worn = write(folder, name)
    if worn is None:
        return build(nominal, seed, **options)
    return restore(nominal, worn, seed, **options)


if __name__ == '__main__':
    for _name in {**PARTS, **BUILDS}:
        print(*(p for p in write(Path(sys.argv[1] if len(sys.argv) > 1 else 'parts'), _name) if p))
