"""What takes up room in a robot cell: arm, torch and positioner as capsules and cylinders of our own drawing.

A capsule is a line from a to b with a radius. It belongs to a frame: those of the links (0 = base, n = end of link n),
TOOL (the wire tip, z towards the part), CRADLE (the faceplate tilted by B, z out of it), PART (turned by C too).
Put the sizes of your own machine in their place.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .arm import AXES, Arm, link_frames
from .positioner import Positioner

TOOL, CRADLE, PART = AXES + 1, AXES + 2, AXES + 3
FRAMES = AXES + 4
RADII = (0.16, 0.08, 0.08, 0.055, 0.05, 0.045)  # m, of the links
NAMES = ('column', 'upper arm', 'elbow', 'forearm', 'wrist', 'hand')
NOZZLE_END = 12e-3  # m above the wire tip: 15 mm of contact distance, the nozzle a little over the contact tube


@dataclass(frozen=True)
class Capsule:
    """a, b: (3,) m in `frame`; radius m; near: it may touch bodies of this link and of all behind it, which it is
    joined to."""

    name: str
    frame: int
    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float
    near: int

    @property
    def link(self) -> int:
        """Of the arm: what the capsule moves with."""
        return min(self.frame, AXES)


@dataclass(frozen=True)
class Cylinder:
    """Of the positioner, along z of `frame`; low, high: m along it; centre: (2,) m."""

    name: str
    frame: int
    radius: float
    low: float
    high: float
    centre: tuple[float, float] = (0.0, 0.0)


# nozzle and swan neck along the torch, then a bracket to the flange (`M20IB25.tool`); all of it turns with the hand
TORCH = (
    Capsule('nozzle', TOOL, (0, 0, -NOZZLE_END - 0.010), (0, 0, -0.120), 0.010, 5),
    Capsule('torch bracket', TOOL, (0, 0, -0.120), (-0.29, 0, -0.090), 0.022, 5),
)
FACEPLATE_RADIUS, FACEPLATE_THICKNESS, STEM, COLUMN = 0.30, 0.02, 0.06, 0.10  # m


@dataclass(frozen=True)
class Block:
    """Of what carries the part, or stands beside the arm. kind: 'box' (size: x, y, z, m), 'cylinder' (radius, length
    along z) or 'sphere' (radius); place: (4, 4) of its middle in `frame`."""

    name: str
    frame: int
    kind: str
    size: tuple[float, ...]
    place: np.ndarray

    @property
    def half(self) -> np.ndarray:
        """(3,) m: half of the box around it, along its own axes."""
        if self.kind == 'box':
            return np.array(self.size) / 2
        along = self.size[1] / 2 if self.kind == 'cylinder' else self.size[0]
        return np.array([self.size[0], self.size[0], along])


@dataclass(frozen=True)
class Bodies:
    """capsules move with the arm; cylinders and blocks do not."""

    capsules: tuple[Capsule, ...]
    cylinders: tuple[Cylinder, ...] = field(default_factory=tuple)
    blocks: tuple[Block, ...] = field(default_factory=tuple)


def bodies_of(arm: Arm, positioner: Positioner, torch: tuple[Capsule, ...] = TORCH) -> Bodies:
    """The arm by its DH table, with the radii of `RADII`; the positioner as the pictures have it."""
    x, y, axis = positioner.faceplate(0.0)[:3, 3]
    axis -= positioner.d_c
    under = positioner.d_c - FACEPLATE_THICKNESS
    cylinders = (
        Cylinder('faceplate', CRADLE, FACEPLATE_RADIUS, -FACEPLATE_THICKNESS, 0.0),
        Cylinder('positioner', CRADLE, STEM, -FACEPLATE_THICKNESS - under, -FACEPLATE_THICKNESS),
        Cylinder('positioner column', 0, COLUMN, min(axis - 1.0, -0.3), axis, (x, y)),
    )
    return Bodies((*arm_capsules(arm), *torch), cylinders)


def arm_capsules(arm: Arm) -> tuple[Capsule, ...]:
    """Every row of the table: its d along the joint, its a across. Rows without length have none."""
    out = []
    for n, link in enumerate(arm.links, 1):
        corner = (-link.a, 0.0, 0.0)
        start = (-link.a, -link.d * float(np.sin(link.alpha)), -link.d * float(np.cos(link.alpha)))
        near = _near(arm, n)
        name, radius = NAMES[n - 1], RADII[n - 1]
        if link.d:
            out.append(Capsule(name, n, start, corner, radius, near))
        if link.a:
            out.append(Capsule(name, n, corner, (0.0, 0.0, 0.0), radius, near))
    return tuple(out)


def _near(arm: Arm, n: int) -> int:
    """The lowest link that link n is always next to: between them is less than their radii."""
    near, between = n - 1, 0.0
    while near > 1:
        link = arm.links[near - 1]
        between += abs(link.d) + abs(link.a)
        if between > RADII[n - 1] + RADII[near - 2]:
            break
        near -= 1
    return max(near, 0)


def frames_of(arm: Arm, positioner: Positioner, joints: np.ndarray) -> np.ndarray:
    """(N, FRAMES, 4, 4): every frame in the robot's base for joints (N, 8)."""
    joints = np.asarray(joints, float)
    theta, b, c = joints[:, :AXES], joints[:, AXES], joints[:, AXES + 1]
    links = link_frames(arm, theta)
    tool = links[:, -1] @ arm.tool
    cradle = positioner.faceplate(b)
    part = positioner.to_robot(np.eye(4), b, c)
    return np.concatenate([links, tool[:, None], cradle[:, None], part[:, None]], axis=1)


def ends(capsules: tuple[Capsule, ...], frames: np.ndarray) -> np.ndarray:
    """(N, K, 2, 3) m: both ends of the capsules' lines in the robot's base, for frames (N, FRAMES, 4, 4)."""
    own = frames[:, [c.frame for c in capsules]]
    points = np.array([(c.a, c.b) for c in capsules])
    return np.asarray(np.einsum('nkij,kpj->nkpi', own[..., :3, :3], points) + own[..., None, :3, 3])
