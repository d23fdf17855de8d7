"""The frames of a machine: a URDF and the positions of its joints in, transforms out. Lengths in m, angles in rad."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

MACHINE, WORK, TORCH, STANDOFF = 'machine', 'work', 'torch_tcp', 'standoff_sensor'
AXES = ('x', 'y', 'z')  # joints of the gantry, along the axes of the machine

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w


class Placed(NamedTuple):
    """A frame `child` in the frame `parent`: xyz in m, rotation as a unit quaternion (x, y, z, w)."""

    parent: str
    child: str
    xyz: Vector
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)


def quaternion(rpy: Iterable[float]) -> Quaternion:
    """Of roll, pitch and yaw about fixed axes, rad, as URDF has them."""
    x, y, z, w = Rotation.from_euler('xyz', list(rpy)).as_quat()
    return float(x), float(y), float(z), float(w)


def matrix(placed: Placed) -> np.ndarray:
    """(4, 4): takes points of the child to the parent, m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat(placed.rotation).as_matrix(), placed.xyz
    return out


def in_root(transforms: Iterable[Placed], frame: str) -> np.ndarray:
    """(4, 4): takes points of `frame` to the root of its tree, m. ValueError where frames go round."""
    above = {t.child: t for t in transforms}
    found, seen = np.eye(4), set()
    while frame in above:
        if frame in seen:
            raise ValueError(f"the frames go round through '{frame}'")
        seen.add(frame)
        found, frame = matrix(above[frame]) @ found, above[frame].parent
    return found


@dataclass(frozen=True)
class _Joint:
    at_rest: Placed
    kind: str
    axis: Vector

    def at(self, position: float) -> Placed:
        turned = Rotation.from_quat(self.at_rest.rotation)
        moved = position * np.array(self.axis)
        if self.kind == 'prismatic':
            x, y, z = (np.array(self.at_rest.xyz) + turned.apply(moved)).tolist()
            return self.at_rest._replace(xyz=(x, y, z))
        x, y, z, w = (turned * Rotation.from_rotvec(moved)).as_quat().tolist()
        return self.at_rest._replace(rotation=(x, y, z, w))


class Tree:
    """`fixed`: the frames that stand still in their parents; `joints`: names of those that move. The text must be that
    of a sound URDF (`waam_robot.urdf_text.check_urdf`)."""

    def __init__(self, urdf: str) -> None:
        self.fixed: list[Placed] = []
        self._joints: dict[str, _Joint] = {}
        for element in ElementTree.fromstring(urdf).iterfind('joint'):
            joint = _joint(element)
            if joint.kind == 'fixed':
                self.fixed.append(joint.at_rest)
            else:
                self._joints[element.attrib['name']] = joint

    @property
    def joints(self) -> tuple[str, ...]:
        """In the order of the file."""
        return tuple(self._joints)

    @property
    def frames(self) -> set[str]:
        """All that are in the URDF."""
        placed = [*self.fixed, *(joint.at_rest for joint in self._joints.values())]
        return {name for p in placed for name in (p.parent, p.child)}

    def at(self, positions: Mapping[str, float]) -> list[Placed]:
        """Every moving frame, for positions (m or rad) by the names of the joints. KeyError for one that is missing."""
        return [joint.at(positions[name]) for name, joint in self._joints.items()]


def _joint(element: ElementTree.Element) -> _Joint:
    def numbers(tag: str, key: str, default: str) -> Vector:
        found = element.find(tag)
        text = default if found is None else found.attrib.get(key, default)
        x, y, z = map(float, text.split())
        return x, y, z

    ends = (element.find(tag) for tag in ('parent', 'child'))
    parent, child = ('' if end is None else end.attrib['link'] for end in ends)
    rotation = quaternion(numbers('origin', 'rpy', '0 0 0'))
    x, y, z = numbers('axis', 'xyz', '1 0 0')
    size = math.hypot(x, y, z)
    at_rest = Placed(parent, child, numbers('origin', 'xyz', '0 0 0'), rotation)
    return _Joint(at_rest, element.attrib['type'], (x / size, y / size, z / size))


@lru_cache(maxsize=1)
def gantry_urdf(low: Vector, high: Vector, speed: float) -> str:
    """A URDF of three axes with the torch at their end: links `machine`, `gantry_x`, `gantry_y`, `torch_tcp` (the wire
    tip, axes of the machine). low, high: m, the envelope in machine coordinates; speed: m/s. Drawn for the eye: the
    floor of the envelope and a torch."""
    (x, y, z), (dx, dy, dz) = low, (b - a for a, b in zip(low, high, strict=True))
    links = (MACHINE, 'gantry_x', 'gantry_y', TORCH)
    drawn = {
        MACHINE: (f'{x + dx / 2} {y + dy / 2} {z - 0.005}', f'<box size="{dx} {dy} 0.01"/>'),
        TORCH: (f'0 0 {0.015 + dz / 2}', f'<cylinder radius="0.012" length="{dz}"/>'),
    }
    lines = ['<robot name="gantry">']
    for link in links:
        if link in drawn:
            place, shape = drawn[link]
            shape = f'<visual><origin xyz="{place}"/><geometry>{shape}</geometry></visual>'
            lines.append(f'  <link name="{link}">{shape}</link>')
        else:
            lines.append(f'  <link name="{link}"/>')
    for n, (name, parent, child) in enumerate(zip(AXES, links, links[1:], strict=False)):
        axis = ' '.join('1' if n == k else '0' for k in range(3))
        lines += [
            f'  <joint name="{name}" type="prismatic">',
            f'    <parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>',
            f'    <limit lower="{low[n]}" upper="{high[n]}" velocity="{speed}" effort="1000.0"/>',
            '  </joint>',
        ]
    return '\n'.join([*lines, '</robot>', ''])


def work_frames(offset: Vector | None, standoff: float) -> list[Placed]:
    """What hangs on any machine: `work` at the work zero (m, machine coordinates; None = unknown), and the distance
    sensor of the standoff control (its x along the view, as sensor_msgs/Range has it) where it reads `standoff` (m; 0 =
    there is none) when the wire tip is on the metal."""
    found = [] if offset is None else [Placed(MACHINE, WORK, offset)]
    if standoff > 0:
        down = quaternion((0.0, math.pi / 2, 0.0))
        found.append(Placed(TORCH, STANDOFF, (0.0, 0.0, standoff), down))
    return found
