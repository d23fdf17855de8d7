"""Arm, torch and positioner of a robot cell in the viewer, as they move; beside the part of `Scene`, in its frame.

The bodies are those that contacts are looked for with (`waam_robot.bodies`). No ROS here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from waam_robot.arm import AXES
from waam_robot.bodies import (
    CRADLE,
    PART,
    TOOL,
    Block,
    Bodies,
    Capsule,
    Cylinder,
    bodies_of,
    ends,
    frames_of,
)
from waam_robot.frames import inverse
from waam_robot.positioner import Positioner
from waam_robot.station import Place, machine_frame
from waam_robot.urdf_bodies import UrdfCell

from . import blueprint as bp

NAMES = {TOOL: 'torch', CRADLE: 'positioner', PART: 'faceplate'}  # of the frames that are no link
ASIDE, ABOVE = np.radians(-25.0), np.radians((20.0, 30.0))  # of the eyes from the way base to part
HALF_VIEW = np.radians(22.0)  # of what the viewer shows
PART_RADIUS = 0.22  # m from the part
ON_PART = (0.04, 0.03, 0.01)  # m from the work zero: what is looked at
ARM, TORCH, POSITIONER = (222, 134, 44), (150, 150, 158), (120, 130, 142)


class Draws(Protocol):
    """What of `Scene` is needed."""

    def keep(self, entity: str, what: rr.AsComponents) -> None:
        """Stays as it is, in every recording."""

    def log(self, t: int, entity: str, what: rr.AsComponents) -> None:
        """At t, ns of ROS time."""

    def show_robot(self, eyes: bp.Eyes) -> None:
        """Views for it."""


class RobotScene:
    """The arm of `waam_robot.arm.M20IB25` before a positioner, or that of a URDF. names: of the joints, of the first
    arm six, tilt and turn; positioner, origin: (3,) m, as the parameters of the robot bridge; urdf: text of the file,
    '' = the first arm. UrdfError for a file that cannot be used."""

    def __init__(
        self,
        names: tuple[str, ...],
        positioner: tuple[float, float, float],
        origin: tuple[float, float, float],
        urdf: bytes | str = '',
    ) -> None:
        self.names = names
        a_b, d_b, d_c = positioner
        self._place = Place(positioner=Positioner(a_b=a_b, d_b=d_b, d_c=d_c), origin=origin)
        self._cell = UrdfCell(urdf, names) if urdf else None
        self._shown = False

    def missing(self, known: Mapping[str, float]) -> str:
        """Which joint is not among those that are known, '' = none."""
        return next((n for n in self.names if n not in known), '')

    def draw(
        self,
        scene: Draws,
        t: int,
        known: Mapping[str, float],
        work_zero: tuple[float, float, float],
    ) -> None:
        """The robot at t (ns of ROS time) with joints known (name -> rad); work_zero: (3,) m, machine coordinates."""
        joints = np.array([[known[name] for name in self.names]])
        place = self._place
        frames, to_work = self._now(joints)
        to_work[:3, 3] -= work_zero
        if not self._shown:
            self._shown = True
            bodies = self._cell.bodies if self._cell else bodies_of(place.arm, place.positioner)
            for entity, what in shapes(bodies).items():
                scene.keep(entity, what)
            part = inverse(to_work) @ [*ON_PART, 1.0]
            scene.show_robot(eyes_of(bodies, frames, part[:3]))
        scene.log(t, bp.ROBOT, _transform(to_work))
        for n, frame in enumerate(frames):
            scene.log(t, entity_of(n), _transform(frame))

    def _now(self, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((FRAMES, 4, 4) in the base of the robot, (4, 4) from there to machine coordinates) for joints (1, n)."""
        place = self._place
        if self._cell is None:
            here = replace(place, tilt=float(joints[0, AXES]))
            turn = None if joints[0, AXES] else float(joints[0, AXES + 1])
            return frames_of(place.arm, place.positioner, joints)[0], machine_frame(here, turn)
        frames = self._cell.frames(joints)[0]
        to_machine = inverse(frames[PART])
        to_machine[:3, 3] -= place.origin
        return frames, to_machine


def eyes_of(bodies: Bodies, frames: np.ndarray, part: np.ndarray) -> bp.Eyes:
    """From in front of the part, a little to the side, so that the arm stands behind it. frames: (FRAMES, 4, 4) in the
    base of the robot; part: (3,) m there, what is looked at."""
    (arm,) = ends(bodies.capsules, frames[None])
    seen = np.concatenate([arm.reshape(-1, 3), [part, frames[PART][:3, 3]]])
    out = np.append((part - frames[0, :3, 3])[:2], 0.0)
    out /= max(float(np.linalg.norm(out)), 1e-9)
    turned = np.array([-out[1], out[0], 0.0])
    level = np.cos(ASIDE) * out + np.sin(ASIDE) * turned
    back, near = (np.cos(a) * level + np.sin(a) * np.array([0.0, 0.0, 1.0]) for a in ABOVE)
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    off = seen - middle
    along = off @ back
    across = np.linalg.norm(off - along[:, None] * back, axis=1)
    far = float((across / np.tan(HALF_VIEW) + along).max())
    cell = bp.Eye(_point(middle + far * back), _point(middle))
    return cell, bp.Eye(_point(part + PART_RADIUS * near), _point(part))


def _point(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def entity_of(frame: int) -> str:
    """Of a frame of `waam_robot.bodies`: links by their number, 0 = the base."""
    return f'{bp.ROBOT}/{NAMES.get(frame, f"link_{frame}")}'


def shapes(bodies: Bodies) -> dict[str, rr.AsComponents]:
    """Entity -> capsules or cylinders that stay in their frame."""
    found: dict[str, rr.AsComponents] = {}
    for frame in sorted({c.frame for c in bodies.capsules}):
        own = [c for c in bodies.capsules if c.frame == frame]
        found[f'{entity_of(frame)}/body'] = _capsules(own, TORCH if frame == TOOL else ARM)
    for n, cylinder in enumerate(bodies.cylinders):
        found[f'{entity_of(cylinder.frame)}/body_{n}'] = _cylinder(cylinder)
    for n, block in enumerate(bodies.blocks):
        found[f'{entity_of(block.frame)}/block_{n}'] = _block(block)
    return found


def _capsules(capsules: list[Capsule], colour: tuple[int, int, int]) -> rr.Capsules3D:
    lines = [np.subtract(c.b, c.a) for c in capsules]
    turned = [Rotation.align_vectors([v], [[0, 0, 1]])[0].as_quat() for v in lines]
    return rr.Capsules3D(
        lengths=[float(np.linalg.norm(v)) for v in lines],
        radii=[c.radius for c in capsules],
        translations=[c.a for c in capsules],
        quaternions=turned,
        colors=[colour],
        fill_mode='solid',
    )


def _cylinder(c: Cylinder) -> rr.Cylinders3D:
    return rr.Cylinders3D(
        lengths=[c.high - c.low],
        radii=[c.radius],
        centers=[(*c.centre, (c.low + c.high) / 2)],
        colors=[POSITIONER],
        fill_mode='solid',
    )


def _block(block: Block) -> rr.AsComponents:
    turned = [Rotation.from_matrix(block.place[:3, :3]).as_quat()]
    usual: dict[str, Any] = {
        'centers': [block.place[:3, 3]], 'quaternions': turned, 'colors': [POSITIONER], 'fill_mode': 'solid',
    }  # fmt: skip
    if block.kind == 'cylinder':
        radius, length = block.size
        return rr.Cylinders3D(lengths=[length], radii=[radius], **usual)
    if block.kind == 'box':
        return rr.Boxes3D(half_sizes=[block.half], **usual)
    return rr.Ellipsoids3D(half_sizes=[block.half], **usual)


def _transform(pose: np.ndarray) -> rr.Transform3D:
    return rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
