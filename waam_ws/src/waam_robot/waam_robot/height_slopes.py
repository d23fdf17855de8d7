"""By how much each stated error of an arm by its table, and of its positioner, lifts what the torch carries."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .arm import AXES, Arm
from .uncertain import WAVES, Stated, UncertainArm


class Mounted(Protocol):
    """What is needed of a `waam_robot.station.Station`."""

    def on_flange(self, held: np.ndarray) -> np.ndarray:
        """(4, 4) in the frame of the flange for (4, 4) as the torch sees it."""

    def to_machine(self, joints: np.ndarray) -> np.ndarray:
        """(4, 4) or (N, 4, 4): from the robot's base to machine coordinates, for joints (N, 8)."""


def of_table(
    station: Mounted, exact: Arm, joints: np.ndarray, scanner: np.ndarray, stated: Stated
) -> np.ndarray:
    """(N, k) m: as `waam_robot.station.Reach.slopes`."""
    seen = station.on_flange(_at(scanner))[:, 3]
    still = Stated(stated.offset, stated.wave, stated.length, 0.0, stated.axis)
    arm = UncertainArm(exact, joints[:, :AXES], still)
    up = _heights(station, joints)
    meant = arm.poses(np.zeros(len(arm.sigma))) @ seen
    out = []
    for k in np.flatnonzero(arm.sigma):
        one = np.zeros(len(arm.sigma))
        one[k] = arm.sigma[k]
        out.append(np.einsum('ni,ni->n', arm.poses(one) @ seen - meant, up))
    return np.column_stack(out + _of_positioner(station, joints, meant, stated))


def _of_positioner(
    station: Mounted, joints: np.ndarray, seen: np.ndarray, stated: Stated
) -> list[np.ndarray]:
    """Of B and C: an offset of each turns the part about its axis as a whole; the waves count as part of it."""
    sigma = float(np.hypot(stated.offset, stated.wave * np.sqrt(len(WAVES))))
    found = []
    for axis in (AXES, AXES + 1):
        moved = joints.copy()
        moved[:, axis] += sigma
        before, after = (_heights(station, j) for j in (joints, moved))
        found.append(np.einsum('ni,ni->n', seen, after - before))
    return found


def _heights(station: Mounted, joints: np.ndarray) -> np.ndarray:
    """(N, 4): with a point of the base, what its height over the part is."""
    return np.broadcast_to(station.to_machine(joints), (len(joints), 4, 4))[:, 2]


def _at(point: np.ndarray) -> np.ndarray:
    out = np.eye(4)
    out[:3, 3] = point
    return out
