"""How far an arm stays from a tilted faceplate, by plain distances: branch and spin at a tilt are chosen by it."""

from __future__ import annotations

import numpy as np

from .arm import AXES, Arm
from .bodies import (
    COLUMN,
    FACEPLATE_RADIUS,
    FACEPLATE_THICKNESS,
    TOOL,
    TORCH,
    Bodies,
    arm_capsules,
    ends,
    frames_of,
)
from .frames import inverse
from .positioner import Positioner

WANTED = 0.02  # m between arm and faceplate
FRONT = 0.03  # m before the faceplate: only places of the torch beyond it count
SAMPLES = np.linspace(0.0, 1.0, 9)  # along a capsule


class PlateClearance:
    """Of an arm from the faceplate at `tilt` (rad)."""

    def __init__(self, arm: Arm, positioner: Positioner, tilt: float) -> None:
        self._arm, self._positioner, self._tilt = arm, positioner, tilt
        self._capsules = Bodies((*arm_capsules(arm), TORCH[1])).capsules
        self._radii = np.array([c.radius for c in self._capsules])

    def of(self, joints: np.ndarray) -> float:
        """m, least distance along (N, 8) joints, whatever their B; negative = inside. inf where the torch is never
        before the faceplate."""
        axes = np.asarray(joints, float).copy()
        axes[:, AXES] = self._tilt
        frames = frames_of(self._arm, self._positioner, axes)
        plate = self._positioner.faceplate(self._tilt)
        to_plate = inverse(plate)
        tips = frames[:, TOOL, :3, 3] @ to_plate[:3, :3].T + to_plate[:3, 3]
        frames = frames[tips[:, 2] >= FRONT]
        if not len(frames):
            return float(np.inf)
        lines = ends(self._capsules, frames)
        a, b = lines[..., 0, :], lines[..., 1, :]
        points = a[..., None, :] + SAMPLES[:, None] * (b - a)[..., None, :]
        held = points @ to_plate[:3, :3].T + to_plate[:3, 3]
        disc = _cylinder(held, FACEPLATE_RADIUS, -FACEPLATE_THICKNESS, 0.0)
        foot = points - [self._positioner.a_b, self._positioner.d_bb, 0.0]
        column = _cylinder(foot, COLUMN, -2.0, self._positioner.d_b)
        free = np.minimum(disc, column) - self._radii[:, None]
        own = (
            np.array([c.link for c in self._capsules]) > 1
        )  # the arm's own foot stands where it stands
        return float(free[:, own].min())


def _cylinder(points: np.ndarray, radius: float, low: float, high: float) -> np.ndarray:
    """(...,) m: distance of points (..., 3) from a cylinder about z."""
    beside = np.maximum(np.hypot(points[..., 0], points[..., 1]) - radius, 0.0)
    over = np.maximum(np.maximum(points[..., 2] - high, low - points[..., 2]), 0.0)
    return np.asarray(np.hypot(beside, over))
