"""Where the cell's box stands before the robot: torch positions in machine coordinates <-> joints of all eight axes.

The torch is upright. The positioner stands still, level or at a tilt, or turns a level part by where the torch is
(`turning`). One branch of the arm and one spin of the torch on the part serve the whole box. Both are chosen once, with
a joint path around the box: away from limits and singularities. Inside the box nothing can flip then.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Protocol

import numpy as np

from .arm import AXES, DEG, Arm, Link, in_limits, limit_text, step
from .arm_choice import JUMP_MAX, OVER, STRETCH_MAX, WRIST_MIN, NoWay, Way, spun, ways
from .frames import inverse, translation
from .inverse import Solutions, nearest_turns, solve, unreachable_text
from .plate_clearance import WANTED, PlateClearance
from .positioner import Machine
from .tilt import MAX_TILT, carriage
from .turning import Turning

JOINTS = AXES + 2
GRID = 25e-3  # m between the places of the box that are looked at
AROUND = 5e-3  # m between the points of the path around the box
STRIDE = 5  # of them, those whose distance from a tilted faceplate is looked at
TINY = 1e-5  # m: a move of the torch
KEPT = 8  # turns of the positioner whose matrices are kept


@cache
def _row(arm_links: tuple[Link, ...]) -> Link:
    """All links as one, with arrays (6,)."""
    d, a, alpha = (np.array([getattr(k, n) for k in arm_links]) for n in ('d', 'a', 'alpha'))
    return Link(d, a, alpha)  # type: ignore[arg-type]


class StationError(ValueError):
    """The robot cannot work in this box; the text says where and why."""


class Reach(Protocol):
    """What moves a torch in a box: `Station`, or `waam_robot.urdf_station.UrdfStation`."""

    def joints(self, tips: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """(N, n) for torch positions (N, 3), m, machine coordinates; near: (n,). StationError beside the reach."""

    def tips(self, joints: np.ndarray) -> np.ndarray:
        """(N, 3) m: the torch in machine coordinates for joints (N, n)."""

    @property
    def gains(self) -> np.ndarray:
        """(n,) rad/m: how far each joint moves at most for a move of the torch, anywhere in the box."""


@dataclass(frozen=True)
class Place(Machine):
    """origin: (3,) m, machine zero on the faceplate (its frame, B = 0, C such that the axes are
    those of the robot's base); low, high: (3,) m, the box in machine coordinates. tilt: rad, B of the positioner; the
    box stays level, with its middle where the tilt carries it. turning: of a level part."""

    origin: tuple[float, float, float] = (-0.2, -0.15, 0.0)
    low: tuple[float, float, float] = (0.0, 0.0, 0.0)
    high: tuple[float, float, float] = (0.4, 0.3, 0.2)
    tilt: float = 0.0
    turning: Turning = field(default_factory=Turning)

    @property
    def middle(self) -> np.ndarray:
        """(3,) m, of the box, machine coordinates."""
        return np.add(self.low, self.high) / 2

    def turns(self, tips: np.ndarray) -> np.ndarray:
        """(N,) rad: C for torch positions (N, 3), m, machine coordinates."""
        return self.turning.at(tips, self.middle) - self.positioner.turn_zero


def box_path(low: np.ndarray, high: np.ndarray, step: float) -> np.ndarray:
    """(N, 3) m: around the lower and then the upper face of a box, and through its middle; `step` m apart at most."""
    flat = np.array([low[:2], [high[0], low[1]], high[:2], [low[0], high[1]], low[:2]])
    around = [np.column_stack([flat, np.full(len(flat), z)]) for z in (low[2], high[2])]
    return evenly(np.concatenate([*around, (low + high)[None] / 2]), step)


def evenly(corners: np.ndarray, step: float) -> np.ndarray:
    """(n, 3) m: corners of a way (m, 3) and places between them, at most `step` m apart."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    counts = np.maximum(np.ceil(lengths / step), 1).astype(int)
    pieces = [
        a + np.arange(n)[:, None] / n * (b - a)
        for a, b, n in zip(corners, corners[1:], counts, strict=False)
    ]
    return np.concatenate([*pieces, corners[-1:]])


def upright_poses(place: Place, tips: np.ndarray) -> np.ndarray:
    """(N, 4, 4) in the robot's base: the axes of the machine at torch positions (N, 3), m, of a level part."""
    held = np.broadcast_to(np.eye(4), (len(tips), 4, 4)).copy()
    held[:, :3, 3] = np.asarray(tips, float) + np.array(place.origin, float)
    return np.asarray(place.positioner.to_robot(held, 0.0, place.turns(tips)))


def best_way(place: Place, path: np.ndarray, jump: float = JUMP_MAX) -> Way | None:
    """The cheapest branch and spin along torch positions (N, 3), m, of a level part; None where none serves all."""
    try:
        return next(ways(place.arm, upright_poses(place, path), jump))
    except NoWay:
        return None


class Station:
    """`spin` (rad) and `branch` serve the whole box. StationError names the place that the arm does not reach."""

    def __init__(self, place: Place | None = None) -> None:
        self.place = place or Place()
        p = self.place
        if not all(a < b for a, b in zip(p.low, p.high, strict=True)):
            raise StationError(f'the box from {p.low} to {p.high} m is empty')
        self._origin = np.array(p.origin, float)
        if not -MAX_TILT <= p.tilt <= MAX_TILT:
            raise StationError(
                f'a tilt of {p.tilt / DEG:.1f} deg: at most {MAX_TILT / DEG:.0f} to both sides'
            )
        if p.tilt and not p.turning.still:
            raise StationError('a tilted part does not turn: its layers would not stay level')
        self.hold = np.array([p.tilt, -p.positioner.turn_zero])  # B, C at rest
        self._level = carriage(p.positioner, self._origin + np.add(p.low, p.high) / 2, p.tilt)
        self._base = self._level.to_robot(np.eye(4), 0.0, self.hold[1])
        # level axes on the tilted faceplate, before the origin is taken off
        self.held = inverse(p.positioner.to_robot(np.eye(4), *self.hold)) @ self._base
        way = self._way()
        self.branch, self.spin, self._middle = way.branch, way.spin, way.middle
        self._tool = spun(self.spin) @ OVER
        self._flange_to_torch = p.arm.tool @ inverse(self._tool)
        self._kept: dict[tuple[float, float], np.ndarray] = {}
        self._check_inside()

    def _way(self) -> Way:
        """The cheapest one around the box that, at a tilt, keeps away from the faceplate."""
        p, path = self.place, self._around()
        try:
            found = ways(p.arm, self._upright(path))
            if not p.tilt:
                return next(found)
            clear = PlateClearance(p.arm, p.positioner, p.tilt)
            hold = np.broadcast_to(self.hold, (len(path), 2))
            best, most = None, -np.inf
            for way in found:
                free = clear.of(np.column_stack([way.joints, hold])[::STRIDE])
                if free > most:
                    best, most = way, free
                if free >= WANTED:
                    break
            assert best is not None  # `ways` raises where there is none
            return best
        except NoWay as e:
            x, y, z = path[e.at] * 1e3 + 0.0
            turned = '' if p.turning.still else f' with the part turned by {p.turning.text}'
            raise StationError(
                f'the robot does not reach all of its box{turned}, ({x:.0f}, {y:.0f}, {z:.0f}) mm of the machine '
                f'not: {e}'
            ) from None

    def _around(self) -> np.ndarray:
        """(N, 3) m: along the lower and the upper face of the box; of a part at rest from where it is turned to."""
        low, high = np.array(self.place.low, float), np.array(self.place.high, float)
        if not self.place.turning.still:
            return box_path(low, high, AROUND)
        x, y = self._origin[:2]
        start = [max(high[0], 1e-3 - x), -y]
        flat = np.array([start, high[:2], [low[0], high[1]], low[:2], [high[0], low[1]], start])
        faces = [np.column_stack([flat, np.full(len(flat), z)]) for z in (low[2], high[2])]
        return evenly(np.concatenate(faces), AROUND)

    def _grid(self) -> np.ndarray:
        """(N, 3) m: places all over the box, GRID apart at most."""
        axes = [
            np.linspace(a, b, int(np.ceil((b - a) / GRID)) + 1)
            for a, b in zip(self.place.low, self.place.high, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 3)

    def _check_inside(self) -> None:
        grid = self._grid()
        found = solve(self.place.arm, self.poses(grid))
        theta = nearest_turns(self.place.arm, found.theta[:, self.branch], self._middle)
        near = np.abs(np.sin(theta[:, 4])) < np.sin(WRIST_MIN)
        near |= np.abs(found.stretch[:, self.branch // 4]) > STRETCH_MAX
        bad = ~found.reachable[:, self.branch] | near | ~in_limits(self.place.arm, theta)
        if bad.any():
            n = int(np.argmax(bad))
            where = ', '.join(f'{v * 1e3:.0f}' for v in grid[n])
            raise StationError(
                f'the robot does not reach ({where}) mm of its box: ' + self._why(found, theta, n)
            )

    def _why(self, found: Solutions, theta: np.ndarray, n: int) -> str:
        if not found.reachable[n, self.branch]:
            return unreachable_text(self.place.arm, found, n)
        said = limit_text(self.place.arm, theta[n])
        return said or f'too near to a singularity (theta5 = {theta[n, 4] / DEG:.1f} deg)'

    def _upright(self, tips: np.ndarray) -> np.ndarray:
        """(N, 4, 4) in the robot's base: the axes of the machine at torch positions (N, 3), m."""
        if not self.place.turning.still:
            return upright_poses(self.place, tips)
        held = np.broadcast_to(np.eye(4), (len(tips), 4, 4)).copy()
        held[:, :3, 3] = np.asarray(tips, float) + self._origin
        return np.asarray(self._base @ held)

    def poses(self, tips: np.ndarray) -> np.ndarray:
        """(N, 4, 4) of the tool in the robot's base frame for torch positions (N, 3), m, machine coordinates."""
        return np.asarray(self._upright(tips) @ self._tool)

    def joints(self, tips: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """(N, 8) rad, the six DH angles, B and C, for torch positions (N, 3), m, machine coordinates.

        near: (6,) or (8,) rad, where the arm is: whole turns are chosen by it. StationError beside the arm's reach.
        """
        found = solve(self.place.arm, self.poses(tips))
        theta = found.theta[:, self.branch]
        if np.isnan(theta).any():
            n = int(np.argmax(np.isnan(theta).any(axis=1)))
            raise StationError(unreachable_text(self.place.arm, found, n))
        reference = self._middle if near is None else np.asarray(near)[:AXES]
        theta = nearest_turns(self.place.arm, theta, reference)
        if self.place.turning.still:
            return np.column_stack([theta, np.broadcast_to(self.hold, (len(theta), 2))])
        return np.column_stack([theta, np.zeros(len(theta)), self.place.turns(tips)])

    @cached_property
    def gains(self) -> np.ndarray:
        """(8,) rad/m: how far each joint moves at most for a move of the torch, anywhere in the box."""
        apart = np.eye(3) * TINY / 2
        grid = self._grid()
        moved = [self.joints(grid + d) - self.joints(grid - d) for d in apart]
        return np.asarray(np.linalg.norm(moved, axis=0).max(axis=0)) / TINY

    def frames(self, joints: np.ndarray, arm: Arm | None = None) -> np.ndarray:
        """(N, 4, 4): the torch in machine coordinates (its x, y, z axes those of the machine where the arm is exact)
        for joints (N, 8). arm: another one than that of the place, for what errors of its links do."""
        joints = np.asarray(joints, float)
        links = step(_row((arm or self.place.arm).links), joints[:, :AXES])  # all six at once
        tool = links[:, 0]
        for n in range(1, AXES):
            tool = tool @ links[:, n]
        tool = tool @ self._flange_to_torch
        return np.asarray(self._to_machine(joints[:, AXES:]) @ tool)

    def _to_machine(self, turned: np.ndarray) -> np.ndarray:
        """(4, 4) or (N, 4, 4): from the robot's base to machine coordinates, for B and C (N, 2)."""
        key = (float(turned[0, 0]), float(turned[0, 1]))
        if len(turned) > 1 and (turned != turned[0]).any():
            return self._of_turns(turned[:, 0], turned[:, 1])
        if key not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.clear()
            self._kept[key] = self._of_turns(*key)
        return self._kept[key]

    def _of_turns(self, b: np.ndarray | float, c: np.ndarray | float) -> np.ndarray:
        found = inverse(self.place.positioner.to_robot(np.eye(4), b, c) @ self.held)
        found[..., :3, 3] -= self._origin
        return found

    def tips(self, joints: np.ndarray) -> np.ndarray:
        """(N, 3) m: the torch in machine coordinates for joints (N, 8)."""
        return self.frames(joints)[:, :3, 3]

    def carried(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) m: where the tilt takes points (N, 3) that stand on the level faceplate, machine coordinates."""
        p = self.place.positioner
        whole = np.column_stack([np.asarray(points, float) + self._origin, np.ones(len(points))])
        there = inverse(self._base) @ p.to_robot(np.eye(4), *self.hold)
        return np.asarray(whole @ there.T)[:, :3] - self._origin

    @property
    def machine_on_part(self) -> np.ndarray:
        """(4, 4): machine coordinates in the frame of the URDF's link `part`, which turns with the faceplate."""
        return np.asarray(self.held @ translation(*self._origin))

    @property
    def tip_on_torch(self) -> np.ndarray:
        """(4, 4): the wire tip with the axes of the machine, in the frame of the URDF's link `torch`."""
        return inverse(self._tool)

    def on_torch(self, held: np.ndarray) -> np.ndarray:
        """(4, 4): something in the frame of the flange (4, 4) as the torch sees it, axes of the machine while it is
        upright."""
        return np.asarray(inverse(self._flange_to_torch) @ held)

    def on_flange(self, held: np.ndarray) -> np.ndarray:
        """(4, 4): the inverse of `on_torch`."""
        return np.asarray(self._flange_to_torch @ held)
