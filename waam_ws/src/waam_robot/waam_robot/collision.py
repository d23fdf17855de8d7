"""Collisions of arm, torch, positioner and the part as it grows, over whole joint paths, by Coal (needs coal).

Capsules of the arm are made `margin` thicker. Every path is looked at so closely that no body moves farther than
`margin` from one place to the next: where nothing touches at the places, nothing touches between them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .arm import AXES
from .bodies import (
    CRADLE,
    FACEPLATE_RADIUS,
    PART,
    Block,
    Bodies,
    Capsule,
    bodies_of,
    ends,
    frames_of,
)
from .positioner import Machine

MARGIN = 2e-3  # m
BLOCK = 2000  # places at once
FINEST = 1e-3  # m: cells of a surface are not finer for the check
THICK = 10e-3  # m: of metal under a surface whose bottom nobody has said


class CollisionError(ValueError):
    """Something cannot be checked; the text says why."""


@dataclass(frozen=True)
class Contact:
    """at: number of the place in the joint path, or of the one before it; bodies: which come nearer than `margin` (m);
    tip: (3,) m, the wire on the part there."""

    at: int
    bodies: tuple[str, str]
    margin: float
    tip: np.ndarray

    @property
    def text(self) -> str:
        """Without the place, which the caller knows better."""
        return f'{self.bodies[0]} within {self.margin * 1e3:g} mm of {self.bodies[1]}'


@dataclass(frozen=True)
class _Solid:
    """Something with a Coal geometry in a frame: its place there, its box there, and for arms their link."""

    name: str
    frame: int
    geometry: Any
    place: np.ndarray
    low: np.ndarray
    high: np.ndarray
    link: int = -1


class Scene:
    """A machine with the part on its faceplate. `margin` (m): nearer is a contact. held: (4, 4), the part's frame on
    the faceplate; None = the same. frames: (N, FRAMES, 4, 4) for joints (N, n) of another cell than the machine's,
    whose bodies are given (`urdf_bodies`)."""

    def __init__(
        self,
        machine: Machine,
        bodies: Bodies | None = None,
        margin: float = MARGIN,
        held: np.ndarray | None = None,
        frames: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        self._coal = _coal()
        if not margin > 0:
            raise CollisionError(f'margin is {margin} m, must be positive')
        self.machine, self.margin = machine, margin
        self._frames_of = frames or partial(frames_of, machine.arm, machine.positioner)
        self._held = np.eye(4) if held is None else np.asarray(held, float)
        self.bodies = bodies or bodies_of(machine.arm, machine.positioner)
        self._probes = [
            self._coal.Capsule(c.radius + margin, _length(c)) for c in self.bodies.capsules
        ]
        self._standing = [self._of_capsule(c) for c in self.bodies.capsules]
        self._standing += [self._of_cylinder(n) for n in range(len(self.bodies.cylinders))]
        self._standing += [self._of_block(block) for block in self.bodies.blocks]
        self._surface: _Solid | None = None

    # ---- the part

    def set_surface(
        self, corner: tuple[float, float], cell: float, heights: np.ndarray, bottom: float = 0.0
    ) -> None:
        """The part so far: heights (rows, cols) m over square cells of `cell` m, rows along y, NaN = nothing there;
        corner: m, of cell (0, 0); all of it in the part's frame. Takes the place of the surface before."""
        heights = np.asarray(heights, float)
        if heights.ndim != 2 or not np.isfinite(heights).any():
            raise CollisionError('a surface needs cells (rows, cols) with a height')
        coarse, cell = _coarse(np.where(np.isfinite(heights), heights, -np.inf), cell)
        bottom = min(bottom, float(coarse[np.isfinite(coarse)].min()) - THICK)
        z = np.where(np.isfinite(coarse), coarse, bottom)
        size = np.array([z.shape[1], z.shape[0]]) * cell
        low = np.array([*corner, bottom])
        high = np.array([*(np.array(corner) + size), float(z.max())])
        place = np.eye(4)
        place[:2, 3] = np.array(corner) + size / 2
        nodes = _nodes(z, bottom)[::-1]  # Coal's rows run along -y
        field = self._coal.HeightFieldAABB(*size, np.ascontiguousarray(nodes), bottom)
        self._surface = _Solid('part', PART, field, place, low, high)

    # ---- the path

    def first(self, joints: np.ndarray) -> Contact | None:
        """The first contact along a joint path (N, 8) rad, straight in the joints between its places."""
        joints, index = self._closely(np.asarray(joints, float))
        for begin in range(0, len(joints), BLOCK):
            some = joints[begin : begin + BLOCK]
            found = self._first(self._frames(some))
            if found is not None:
                n, names = found
                frames = self._frames(some[n : n + 1])[0]
                tip = np.linalg.inv(frames[PART]) @ frames[AXES + 1][:, 3]
                return Contact(int(index[begin + n]), names, self.margin, tip[:3])
        return None

    def _frames(self, joints: np.ndarray) -> np.ndarray:
        """(N, FRAMES, 4, 4) in the robot's base, that of the part where it is held."""
        frames = self._frames_of(joints)
        frames[:, PART] = frames[:, PART] @ self._held
        return frames

    def _closely(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places so near to each other that nothing moves farther than margin, and which given one is before each."""
        if len(joints) < 2:
            return joints, np.arange(len(joints))
        moved = np.concatenate(
            [self._moved(joints[n : n + BLOCK + 1]) for n in range(0, len(joints) - 1, BLOCK)]
        )
        places = _spaced(moved, self.margin)
        index = np.minimum(places.astype(int), len(joints) - 1)
        share = (places - index)[:, None]
        after = np.minimum(index + 1, len(joints) - 1)
        return joints[index] + share * (joints[after] - joints[index]), index

    def _moved(self, joints: np.ndarray) -> np.ndarray:
        """(N - 1,) m: how far anything moves at most from place to place, arm and part against the base."""
        frames = self._frames(joints)
        arm = np.linalg.norm(np.diff(ends(self.bodies.capsules, frames), axis=0), axis=-1)
        turn = frames[:, PART]
        low, high = self._part_box()
        corners = np.array([[x, y, z, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1])
                            for z in (low[2], high[2])])  # fmt: skip
        part = np.einsum('nij,kj->nki', turn, corners)[..., :3]
        held = np.linalg.norm(np.diff(part, axis=0), axis=-1)
        return np.asarray(arm.max(axis=(1, 2)) + held.max(axis=1))

    def _part_box(self) -> tuple[np.ndarray, np.ndarray]:
        """(3,), (3,) m, part's frame: part and faceplate."""
        r = FACEPLATE_RADIUS
        low, high = np.array([-r, -r, -0.1]), np.array([r, r, 0.0])
        if self._surface:
            low, high = np.minimum(low, self._surface.low), np.maximum(high, self._surface.high)
        return low, high

    def _first(self, frames: np.ndarray) -> tuple[int, tuple[str, str]] | None:
        """(place, names) of the first contact at the places (N, FRAMES, 4, 4)."""
        best: tuple[int, tuple[str, str]] | None = None
        lines = ends(self.bodies.capsules, frames)
        for k, capsule in enumerate(self.bodies.capsules):
            boxes: dict[int, np.ndarray] = {}
            for solid in self._against(capsule):
                stop = len(frames) if best is None else best[0]
                box = boxes.setdefault(solid.frame, self._box(k, lines, frames, solid.frame))
                near = np.flatnonzero(_overlap(box[:stop], solid.low, solid.high))
                at = next((int(n) for n in near if self._touch(k, frames[n], solid)), None)
                if at is not None:
                    best = at, (capsule.name, solid.name)
        return best

    def _against(self, capsule: Capsule) -> list[_Solid]:
        """What a capsule may hit: lower links that it is not joined to, the positioner, the part."""
        others = [
            s
            for s in self._standing
            if (s.link < 0 and capsule.link > 1) or 0 <= s.link < min(capsule.near, capsule.link)
        ]
        return others + ([self._surface] if self._surface and capsule.link > 1 else [])

    def _box(self, k: int, lines: np.ndarray, frames: np.ndarray, frame: int) -> np.ndarray:
        """(N, 2, 3): the least and greatest coordinates in a frame that capsule k with its margin has."""
        own, thick = frames[:, frame], self.bodies.capsules[k].radius + self.margin
        seen = lines[:, k] - own[:, None, :3, 3]
        seen = np.einsum('nji,npj->npi', own[:, :3, :3], seen)
        return np.stack([seen.min(axis=1) - thick, seen.max(axis=1) + thick], axis=1)

    def _touch(self, k: int, frames: np.ndarray, solid: _Solid) -> bool:
        capsule = self._standing[k]
        request, result = self._coal.CollisionRequest(), self._coal.CollisionResult()
        here = self._pose(frames[capsule.frame] @ capsule.place)
        there = self._pose(frames[solid.frame] @ solid.place)
        return bool(
            self._coal.collide(self._probes[k], here, solid.geometry, there, request, result)
        )

    def _pose(self, pose: np.ndarray) -> Any:
        return self._coal.Transform3s(pose[:3, :3], pose[:3, 3])

    # ---- geometry

    def _of_capsule(self, c: Capsule) -> _Solid:
        a, b = np.array(c.a, float), np.array(c.b, float)
        shape = self._coal.Capsule(c.radius, _length(c))
        low, high = np.minimum(a, b) - c.radius, np.maximum(a, b) + c.radius
        link = -1 if c.frame in (CRADLE, PART) else c.link
        return _Solid(c.name, c.frame, shape, _along(a, b), low, high, link)

    def _of_cylinder(self, n: int) -> _Solid:
        c = self.bodies.cylinders[n]
        centre = np.array([*c.centre, (c.low + c.high) / 2])
        half = np.array([c.radius, c.radius, (c.high - c.low) / 2])
        place = np.eye(4)
        place[:3, 3] = centre
        shape = self._coal.Cylinder(c.radius, c.high - c.low)
        return _Solid(c.name, c.frame, shape, place, centre - half, centre + half)

    def _of_block(self, block: Block) -> _Solid:
        made = {'box': 'Box', 'cylinder': 'Cylinder', 'sphere': 'Sphere'}[block.kind]
        shape = getattr(self._coal, made)(*block.size)
        centre, half = block.place[:3, 3], np.abs(block.place[:3, :3]) @ block.half
        return _Solid(block.name, block.frame, shape, block.place, centre - half, centre + half)


def _spaced(moved: np.ndarray, most: float) -> np.ndarray:
    """(k,) places in a path, as the number of a given one and the share of the way to the next; moved: (N - 1,) m from
    one given place to the next. From each to the next at most `most` m are moved; first and last are given ones."""
    out, gone, last = [0.0], 0.0, 0
    for n, step in enumerate(moved.tolist()):
        if gone + step > most and last != n:
            out.append(float(n))
            gone, last = 0.0, n
        gone += step
        if step > most:  # the given places are too far apart
            count = int(np.ceil(step / most))
            out += [n + k / count for k in range(1, count + 1)]
            gone, last = 0.0, n + 1
    if last != len(moved):
        out.append(float(len(moved)))
    return np.array(out)


def _overlap(box: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(N,) bool: boxes (N, 2, 3) that have something in common with that from low to high."""
    return np.asarray(((box[:, 0] <= high) & (box[:, 1] >= low)).all(axis=1))


def _coal() -> Any:
    try:
        import coal
    except ImportError:
        raise CollisionError(
            'collisions need coal: pip install -r requirements-robot.txt'
        ) from None
    return coal


def _length(c: Capsule) -> float:
    return float(np.linalg.norm(np.subtract(c.b, c.a)))


def _along(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(4, 4): origin between a and b, z from a to b."""
    out = np.eye(4)
    out[:3, 3] = (a + b) / 2
    length = np.linalg.norm(b - a)
    if length > 1e-9:
        z = (b - a) / length
        x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
        x /= np.linalg.norm(x)
        out[:3, 0], out[:3, 1], out[:3, 2] = x, np.cross(z, x), z
    return out


def _coarse(z: np.ndarray, cell: float) -> tuple[np.ndarray, float]:
    """Cells of at least FINEST with the highest of those in them (-inf = nothing)."""
    n = max(1, int(np.ceil(FINEST / cell - 1e-9)))
    rows, cols = (-(-k // n) for k in z.shape)
    padded = np.full((rows * n, cols * n), -np.inf)
    padded[: z.shape[0], : z.shape[1]] = z
    return padded.reshape(rows, n, cols, n).max(axis=(1, 3)), cell * n


def _nodes(z: np.ndarray, bottom: float) -> np.ndarray:
    """(rows + 1, cols + 1): heights at the corners of cells, each the highest around it."""
    padded = np.pad(z, 1, constant_values=bottom)
    pairs = np.maximum(padded[1:], padded[:-1])
    return np.asarray(np.maximum(pairs[:, 1:], pairs[:, :-1]))
