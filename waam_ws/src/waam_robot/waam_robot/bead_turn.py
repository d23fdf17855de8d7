"""How the positioner holds the part along a bead: the tilt B makes it flat, the turn C follows its lean or its points,
or stands still. Where C is free by a constant, several are tried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm import DEG
from .bead import Bead, evened
from .frames import wrapped
from .positioner import Positioner
from .split import SplitLimits, chord_error, radius_error

LEAN = 3 * DEG  # a bead whose torch leans more than this everywhere decides C by its lean


@dataclass(frozen=True)
class Turn:
    """b, c: (N,) rad; mode: 'lean', 'follow' or 'hold'; points (N, 3) m and axes (N, 3) of the torch in the robot's
    frame."""

    b: np.ndarray
    c: np.ndarray
    mode: str
    points: np.ndarray
    axes: np.ndarray

    @property
    def off_flat(self) -> np.ndarray:
        """(N,) rad: angle of the torch to upright."""
        return np.arctan2(np.hypot(self.axes[:, 0], self.axes[:, 1]), self.axes[:, 2])

    def some(self, places: np.ndarray) -> Turn:
        """At some of the points."""
        return Turn(
            self.b[places], self.c[places], self.mode, self.points[places], self.axes[places]
        )


def turns_of(
    bead: Bead,
    positioner: Positioner,
    limits: SplitLimits,
    blend: float,
    before: float | None,
    count: int,
) -> list[Turn]:
    """B and C along a bead, the usual ones first. blend: m to both sides over which C is evened out; before: C at the
    end of the bead before; count: how many constants are tried where C is free by one. A torch that leans leaves two:
    the part may tilt to either side."""
    mode, swing = _azimuth(bead, limits)
    swing = evened(swing, int(blend / bead.way[1]))
    first = float(wrapped(swing[0] + 3 * np.pi / 2))
    if before is not None:
        first = before if mode == 'hold' else before + float(wrapped(np.array(first - before)))
    usual = first + swing - swing[0]
    ways = min(count, 2) if mode == 'lean' else count
    apart = wrapped(np.arange(ways) * 2 * np.pi / ways)
    return [_turn(bead, positioner, mode, usual + a) for a in apart.tolist()]


def _turn(bead: Bead, positioner: Positioner, mode: str, c: np.ndarray) -> Turn:
    seen = positioner.turned(_poses(bead.points, bead.axes), c)
    b = np.arctan2(seen[:, 0, 2], seen[:, 2, 2])
    held = positioner.faceplate(b) @ seen
    return Turn(b, c, mode, held[:, :3, 3], held[:, :3, 2])


def _azimuth(bead: Bead, limits: SplitLimits) -> tuple[str, np.ndarray]:
    """How C goes along a bead, and the azimuth (N,) that it follows, without jumps."""
    flat = np.hypot(bead.axes[:, 0], bead.axes[:, 1])
    if np.arctan2(flat, bead.axes[:, 2]).min() >= LEAN:
        return 'lean', np.unwrap(np.arctan2(-bead.axes[:, 1], -bead.axes[:, 0]))
    radius = np.hypot(bead.points[:, 0], bead.points[:, 1])
    if radius.min() >= limits.r_crit:
        azimuth = np.unwrap(np.arctan2(bead.points[:, 1], bead.points[:, 0]))
        near0 = chord_error(radius[:-1], np.diff(azimuth)) <= limits.delta0
        near1 = radius_error(radius[:-1], radius[1:]) <= limits.delta1
        if near0.all() and near1.all() and abs(azimuth[-1] - azimuth[0]) > np.pi / 2:
            return 'follow', azimuth  # it goes around the axis
    return 'hold', np.full(len(bead.points), np.arctan2(bead.points[0, 1], bead.points[0, 0]))


def _poses(points: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """(N, 4, 4) with z along the axes; x anyhow."""
    helper = np.where(np.abs(axes[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    return framed(points, axes, helper)


def framed(points: np.ndarray, z: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(N, 4, 4): z as given, x as near to `towards` (N, 3) as a right angle to z allows."""
    x = towards - np.einsum('ij,ij->i', z, towards)[:, None] * z
    x /= np.linalg.norm(x, axis=1)[:, None]
    out = np.zeros((len(points), 4, 4))
    out[:, :3, 0], out[:, :3, 1], out[:, :3, 2], out[:, :3, 3] = x, np.cross(z, x), z, points
    out[:, 3, 3] = 1.0
    return out
