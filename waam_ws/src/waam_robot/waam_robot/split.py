"""A path divided between robot and positioner (S3 section 2.3): the positioner turns the part where that replaces robot
motion within two error limits, the robot does what is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .frames import check_poses, rotation, wrapped
from .positioner import Positioner

STATION = 3 * np.pi / 2  # table 2.2: C = 270 degrees + azimuth
AXIAL = 1e-12  # m: nearer to the axis a point has no azimuth


@dataclass(frozen=True)
class SplitLimits:
    """delta0: m, largest distance between arc and chord (S3 eq 2.15); delta1: largest relative change of the radius
    (S3 eq 2.16); r_crit: m, nearer to the axis the robot works alone (S3 eq 2.17). The source gives no
    number for the first two. ValueError for a limit that is not positive.
    """

    delta0: float = 0.2e-3
    delta1: float = 0.02
    r_crit: float = 10e-3

    def __post_init__(self) -> None:
        for name in ('delta0', 'delta1', 'r_crit'):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f'{name} = {value}: wanted a positive number')


@dataclass(frozen=True)
class Split:
    """b, c: (N,) positioner angles, rad, C without jumps; turns: (N,) bool, whether the positioner turns on the way to
    the point; radius: (N,) m; delta0 (m), delta1: (N,) errors that the turn to the point would have; part: (N, 4, 4)
    tool poses as given; robot: (N, 4, 4) where the robot holds the tool (X01), robot's frame. The tool keeps its axis
    on the part but does not spin about it while the part turns.
    """

    b: np.ndarray
    c: np.ndarray
    turns: np.ndarray
    radius: np.ndarray
    delta0: np.ndarray
    delta1: np.ndarray
    part: np.ndarray
    robot: np.ndarray

    @property
    def program(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) points of the part (m) and (N, 3) W, P, R (rad): the source's form of table 2.2, W = -B, P = 0, R = C.

        The torch then stands upright everywhere. It is the torch direction of the part only where that leans along the
        radius; `leaning` says by how much it is not.
        """
        angles = np.stack([-self.b, np.zeros_like(self.b), self.c], axis=-1)
        return self.part[:, :3, 3], angles

    @property
    def leaning(self) -> np.ndarray:
        """(N,): angle between the torch of `program` and that of the part, rad."""
        own = (rotation(2, self.c) @ rotation(0, -self.b))[:, :3, 2]
        given = self.part[:, :3, 2]
        return np.arctan2(
            np.linalg.norm(np.cross(own, given), axis=1), np.einsum('ij,ij->i', own, given)
        )


def tilt(poses: np.ndarray) -> np.ndarray:
    """(N,): B that makes the tool axes of poses (N, 4, 4) upright, S3 eqs 2.8 and 2.9."""
    i, j, k = poses[..., 0, 2], poses[..., 1, 2], poses[..., 2, 2]
    return -np.arctan2(np.hypot(i, j), k)


def critical_radius(speed: float, turn_speed: float) -> float:
    """m: nearer to the axis the turn cannot follow the travel speed (m/s, rad/s), S3 eq 2.17.

    The source's 0.15 mm divides mm/s by degrees per second; 20 mm/s at 190 deg/s is 6.0 mm.
    """
    return speed / turn_speed


def chord_error(radius: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """m: largest distance between the arc of a turn (rad) at a radius and its chord, S3 eqs 2.12 to 2.14."""
    return radius * (1 - np.cos(turn / 2))


def radius_error(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """|1 - R(i-1)/R(i)|, S3 eq 2.16; infinite on the axis."""
    with np.errstate(divide='ignore', invalid='ignore'):
        out = np.abs(1 - before / after)
    return np.where(np.isnan(out), np.inf, out)


def turn_angle(points: np.ndarray) -> np.ndarray:
    """(N,): C that brings points (N, 2+) to where the robot works, 270 degrees + azimuth, in 0 ... 2 pi.

    The source computes it from the direction of the tool with shifts per quadrant; only this form gives its table 2.2.
    """
    return (STATION + np.arctan2(points[:, 1], points[:, 0])) % (2 * np.pi)


def split(
    poses: np.ndarray,
    positioner: Positioner | None = None,
    limits: SplitLimits | None = None,
    start: float | None = None,
) -> Split:
    """Divides tool poses (N, 4, 4) of the part's frame.

    start: C at the first point, rad; by default the one that brings it to the robot's side. From there on every turn is
    the change of the point's azimuth, so that after a stretch that the robot did alone the positioner goes on from
    where it stands. ValueError for poses that are none.
    """
    positioner, limits = positioner or Positioner(), limits or SplitLimits()
    poses = check_poses(poses, 'point')
    xy = poses[:, :2, 3]
    radius = np.hypot(xy[:, 0], xy[:, 1])
    azimuth = np.arctan2(xy[:, 1], xy[:, 0])
    swing = wrapped(np.diff(azimuth, prepend=azimuth[:1]))
    before = np.concatenate([radius[:1], radius[:-1]])
    delta0, delta1 = chord_error(before, swing), radius_error(before, radius)
    turns = (delta0 <= limits.delta0) & (delta1 <= limits.delta1) & (radius >= limits.r_crit)
    turns &= before > AXIAL
    turns[:1] = False
    if start is None:
        start = float(turn_angle(xy[:1])[0]) if len(poses) else 0.0
    c = start + np.cumsum(np.where(turns, swing, 0.0))
    b = tilt(poses)
    robot = without_spin(positioner.to_robot(poses, b, c))
    return Split(b, c, turns, radius, delta0, delta1, poses, robot)


def without_spin(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) with the same points and z axes, whose x axes are all as near as possible to the first one.

    A torch is round: its turn about its own axis is free. Where the x axis of the first pose is the z axis of another,
    that one stays as it is.
    """
    out = poses.copy()
    if not len(poses):
        return out
    z = poses[:, :3, 2]
    x = poses[0, :3, 0] - (z @ poses[0, :3, 0])[:, None] * z
    length = np.linalg.norm(x, axis=1)
    x[length < 1e-6] = poses[length < 1e-6, :3, 0]
    x /= np.linalg.norm(x, axis=1)[:, None]
    out[:, :3, 0], out[:, :3, 1] = x, np.cross(z, x)
    return out
