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
    """A body on a floor at z = 0 (mm)."""

    plan: np.ndarray  # (m, n, 2) corners of the grid
    kept: np.ndarray  # (m - 1, n - 1) bool, quadrangles with metal
    nominal: np.ndarray  # (m, n) heights
    worn: np.ndarray | None = None  # (m, n) heights; None = built from nothing

    def meshes(self) -> tuple[trimesh.Trimesh, trimesh.Trimesh | None]:
        """Nominal and as found, closed."""
        found = None if self.worn is None else body(self.plan, self.kept, self.worn)
        return body(self.plan, self.kept, self.nominal), found


def body(plan: np.ndarray, kept: np.ndarray, top: np.ndarray) -> trimesh.Trimesh:
    """Closed mesh between the floor and a height field, mm. Arrays as of `Shape`."""
    m, n = top.shape
    upper = np.concatenate([plan, top[..., None]], axis=2).reshape(-1, 3)
    lower = upper * (1.0, 1.0, 0.0)
    index = np.arange(m * n).reshape(m, n)
    corners = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    # first index runs along x: counter-clockwise
    quads = np.stack([c[kept] for c in corners], axis=1)
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


RANDOM = {
    'pocket': 0.2, 'blob': 0.17, 'l': 0.1, 'capsule': 0.08, 'two': 0.05, 'ring pocket': 0.08, 'top': 0.12,
    'top l': 0.08, 'ring': 0.07, 'disc': 0.05,
}  # fmt: skip


def random_part(rng: np.random.Generator) -> Shape:
    """A worn part of random outline, size, depth (2.5 to 7 mm) and waviness: worn pockets in a plate, or a whole worn
    top. None of the parts above is among them."""
    kind = str(rng.choice(list(RANDOM), p=list(RANDOM.values())))
    depth = rng.uniform(2.5, 7)
    if kind in ('ring', 'disc'):
        radii = (
            (rng.uniform(10, 22), rng.uniform(28, 38))
            if kind == 'ring'
            else (0.0, rng.uniform(14, 24))
        )
        plan, turn = _disc(*radii)
        outward = np.linspace(0 if kind == 'disc' else 1, 1, len(turn))[
            :, None
        ]  # one height at the centre
        wear = depth * (1 + outward * rng.uniform(0, 0.3) * np.cos(turn - rng.uniform(0, 6)))
        wear += 0.05 * depth * outward * np.sin(rng.integers(2, 6) * turn)
        return Shape(plan, _all(plan), np.full(turn.shape, 20.0), 20.0 - wear)
    length, width = rng.uniform(42, 92), rng.uniform(28, 60)
    if kind in ('top', 'top l'):
        plan, x, y = _rectangle(length, width)
        arm = rng.uniform(18, 0.6 * width + 4)
        kept = _all(plan) if kind == 'top' else (_middles(x) < arm + 4) | (_middles(y) < arm)
        tilt = rng.uniform(0, 0.4) * (x / length - 0.5) + rng.uniform(-0.4, 0.4) * (y / width - 0.5)
        wear = depth * (1 + tilt) + _waves(rng, x, y, 0.3)
        return Shape(plan, kept, np.full(x.shape, 22.0), 22.0 - wear)
    plan, x, y = _rectangle(length + 16, width + 16)
    u, v = x - (length + 16) / 2, y - (width + 16) / 2
    turned = rng.uniform(-0.5, 0.5)
    u, v = u * np.cos(turned) + v * np.sin(turned), v * np.cos(turned) - u * np.sin(turned)
    half = rng.uniform(0.72, 0.95)
    inside = _pocket(kind, rng, u, v, half * length / 2, half * width / 2)
    wear = depth * _soft(inside, rng.uniform(3, 14))
    wear *= 1 + _waves(rng, x, y, 0.06) + rng.uniform(-0.2, 0.2) * u / (half * length / 2)
    return Shape(plan, _all(plan), np.full(x.shape, 24.0), 24.0 - np.maximum(wear, 0.0))


def random_wall(rng: np.random.Generator) -> Shape:
    """A worn wall 3 to 10 mm thick: straight, bowed, or closed to a ring; worn by 3 to 7 mm, unevenly."""
    thick, depth = rng.uniform(3, 10), rng.uniform(3, 7)
    if rng.random() < 0.3:
        outer = rng.uniform(15, 38)
        plan, turn = _disc(outer - thick, outer)
        share = 0.5 + 0.5 * np.cos(turn - rng.uniform(0, 6))
        ripple = np.cos(rng.integers(2, 7) * turn)
    else:
        length, bow = rng.uniform(40, 95), rng.uniform(-1.6, 1.6)  # bow: rad over the length
        way, off = np.meshgrid(
            np.linspace(-0.5, 0.5, round(length) + 1) * length,
            np.linspace(-0.5, 0.5, max(4, round(2 * thick)) + 1) * thick,
            indexing='ij',
        )
        angle = way * bow / length
        x = (length / bow - off) * np.sin(angle) if abs(bow) > 0.05 else way
        y = (length / bow) - (length / bow - off) * np.cos(angle) if abs(bow) > 0.05 else off
        plan = np.stack([x, y], axis=2)
        plan -= plan.reshape(-1, 2).min(axis=0)
        share = way / length + 0.5
        ripple = np.sin(rng.uniform(4, 12) * share)
    wear = depth * (1 + rng.uniform(0, 0.4) * (share - 0.5)) + 0.05 * depth * ripple
    return Shape(plan, _all(plan), np.full(wear.shape, 24.0), 24.0 - wear)


def random_build(rng: np.random.Generator) -> Shape:
    """A part to build from nothing, 7 to 14 mm high: disc, ring, rectangle, or L."""
    height = rng.uniform(7, 14)
    kind = str(rng.choice(['disc', 'ring', 'rectangle', 'l'], p=[0.35, 0.2, 0.25, 0.2]))
    if kind in ('disc', 'ring'):
        outer = rng.uniform(9, 26)
        plan, x = _disc(0.0 if kind == 'disc' else rng.uniform(0.3, 0.75) * outer, outer)
        return Shape(plan, _all(plan), np.full(x.shape, height))
    length, width = rng.uniform(20, 70), rng.uniform(14, 45)
    plan, x, y = _rectangle(length, width)
    arm = rng.uniform(9, 0.6 * min(length, width) + 3)
    kept = _all(plan) if kind == 'rectangle' else (_middles(x) < arm) | (_middles(y) < arm)
    return Shape(plan, kept, np.full(x.shape, height))


def _pocket(
    kind: str, rng: np.random.Generator, u: np.ndarray, v: np.ndarray, a: float, b: float
) -> np.ndarray:
    """Distance (mm) inside a random outline that fits a rectangle of half sides a, b."""
    if kind == 'pocket':
        return _box(u, v, a, b, rng.uniform(0, min(a, b)))
    if kind == 'blob':
        angle = np.arctan2(v, u)
        radius = 1 + sum(
            rng.uniform(-0.14, 0.14) * np.cos(k * angle + rng.uniform(0, 6)) for k in range(1, 5)
        )
        return (radius - np.hypot(u / a, v / b)) * min(a, b)
    if kind == 'l':
        arm = rng.uniform(9, 13)
        return np.maximum(_box(u, v + b - arm, a, arm, 4), _box(u + a - arm, v, arm, b, 4))
    if kind == 'capsule':
        return _box(u, v, a, rng.uniform(7, 12), 7)
    if kind == 'two':
        left = _box(u + 0.55 * a, v, 0.42 * a, b, 5)
        return np.maximum(left, _box(u - 0.55 * a, v, 0.42 * a, 0.8 * b, 5))
    hole = _box(u - rng.uniform(-4, 4), v, rng.uniform(4, 8), rng.uniform(4, 8), 3)
    return np.minimum(_box(u, v, a, b, 6), -hole)


def _box(x: np.ndarray, y: np.ndarray, a: float, b: float, r: float) -> np.ndarray:
    """Distance (mm) inside a rectangle of half sides a, b with corners of radius r."""
    dx, dy = abs(x) - a + r, abs(y) - b + r
    outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
    return r - outside - np.minimum(np.maximum(dx, dy), 0)


def _waves(rng: np.random.Generator, x: np.ndarray, y: np.ndarray, height: float) -> np.ndarray:
    return height * np.sin(x / rng.uniform(6, 14) + 1) * np.cos(y / rng.uniform(6, 14))


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
