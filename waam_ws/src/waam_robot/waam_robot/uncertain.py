"""Where a flange is when the arm is not exact: stated errors as unknowns with a standard deviation each.

Calibrations estimate these unknowns together with what they look for. So what the errors of a robot can hide is in the
uncertainty of the result, also where it leaves no trace in the residuals. The errors are those of `waam_robot.accuracy`
and, beside them, of the lengths of the arm and the backlash of every axis, which is another one in every pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .arm import AXES, Arm, Link, step

WAVES = (1, 8)  # periods per turn of the two waves of a gear, as AxisErrors has them


@dataclass(frozen=True)
class Stated:
    """Standard deviations. offset, wave: of every axis, rad; length: of every length of the arm, m; backlash: whole
    width at every axis, rad; axis: of the positioner's turn axis, m."""

    offset: float = np.radians(0.02)
    wave: float = np.radians(0.005)
    length: float = 1e-4
    backlash: float = 3e-5
    axis: float = 5e-5

    def __post_init__(self) -> None:
        for name in ('offset', 'wave', 'length', 'backlash', 'axis'):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f'stated error {name} is {value}, wanted a number of at least 0')


class Flange(Protocol):
    """Poses of a flange with unknown errors. sigma: (k,) standard deviations of the unknowns."""

    @property
    def sigma(self) -> np.ndarray: ...

    def poses(self, errors: np.ndarray) -> np.ndarray:
        """(n, 4, 4) for errors (k,)."""


class UncertainArm:
    """theta: (n, 6) rad, the DH angles of n poses, as the drives tell them."""

    def __init__(self, arm: Arm, theta: np.ndarray, stated: Stated | None = None) -> None:
        self._arm, self._theta = arm, np.asarray(theta, float)
        s = stated or Stated()
        self._lengths = [
            (row, name)
            for row, link in enumerate(arm.links)
            for name in 'da'
            if getattr(link, name)
        ]
        waves = 2 * len(WAVES) * AXES
        self._sigma = np.concatenate(
            [
                np.full(AXES, s.offset),
                # a wave of random phase: sine and cosine, each with half of its variance
                np.full(waves, s.wave / np.sqrt(2)),
                np.full(len(self._lengths), s.length),
                np.full(self._theta.size, s.backlash / 2),
            ]
        )
        self._parts = np.cumsum([AXES, waves, len(self._lengths)])
        angles = [n * self._theta for n in WAVES]
        self._waves = np.stack([f(a) for a in angles for f in (np.sin, np.cos)])  # (4, n, 6)

    @property
    def sigma(self) -> np.ndarray:
        """(k,) rad, m: offsets, waves, lengths, and what the backlash does in each pose."""
        return self._sigma

    def poses(self, errors: np.ndarray) -> np.ndarray:
        """(n, 4, 4) of the flange in the base frame."""
        offset, waves, lengths, play = np.split(np.asarray(errors, float), self._parts)
        theta = self._theta + offset + play.reshape(self._theta.shape)
        theta = theta + np.einsum('wj,wnj->nj', waves.reshape(-1, AXES), self._waves)
        rows = [{'d': link.d, 'a': link.a} for link in self._arm.links]
        for (number, name), off in zip(self._lengths, lengths, strict=True):
            rows[number][name] += float(off)
        pose = np.broadcast_to(np.eye(4), (len(theta), 4, 4))
        for n, (row, link) in enumerate(zip(rows, self._arm.links, strict=True)):
            pose = pose @ step(Link(row['d'], row['a'], link.alpha), theta[:, n])
        return np.asarray(pose)


class UncertainPoses:
    """Flange poses (n, 4, 4) of a robot that is not known: each off by position (m) and angle (rad), one standard
    deviation for every direction, independent from pose to pose."""

    def __init__(self, poses: np.ndarray, position: float = 2e-4, angle: float = np.radians(0.02)):
        self._poses = np.asarray(poses, float)
        self._sigma = np.tile(np.repeat([position, angle], 3), len(self._poses))

    @property
    def sigma(self) -> np.ndarray:
        """(6 n,) m, rad."""
        return self._sigma

    def poses(self, errors: np.ndarray) -> np.ndarray:
        """(n, 4, 4) of the flange in the base frame."""
        off = np.asarray(errors, float).reshape(-1, 6)
        out = self._poses.copy()
        out[:, :3, :3] = turns(off[:, 3:]) @ out[:, :3, :3]
        out[:, :3, 3] += off[:, :3]
        return out


def turns(vectors: np.ndarray) -> np.ndarray:
    """(..., 3, 3): turns about the vectors (..., 3) by their length, rad (Rodrigues)."""
    v = np.asarray(vectors, float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    k = np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2
    )
    small = np.maximum(angle, 1e-12)
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * k + (1 - np.cos(angle)) / small**2 * (k @ k)
    )
