"""URDF files: a writer for arm and positioner of our own drawing, and a check of any file before a library reads it."""

from __future__ import annotations

from collections.abc import Sequence
from xml.parsers import expat

import numpy as np

from .arm import AXES, Link
from .bodies import CRADLE, TOOL, bodies_of
from .bodies import PART as PART_FRAME
from .frames import rotation, translation, wpr
from .positioner import Machine, Positioner

MAX_URDF_BYTES = 5_000_000  # bytes
MAX_JOINTS = 60
KINDS = ('revolute', 'continuous', 'prismatic', 'fixed')
POSITIONER_JOINTS = ('tilt', 'turn')
JOINT_NAMES = (*(f'joint{n + 1}' for n in range(AXES)), *POSITIONER_JOINTS)
TORCH, PART = 'torch', 'part'


class UrdfError(ValueError):
    """What is wrong in a file, with its line where there is one."""


# ---- writing -----------------------------------------------------------------------------------


def write_urdf(
    machine: Machine,
    speeds: np.ndarray,
    name: str = 'arm_and_positioner',
    joints: Sequence[str] = JOINT_NAMES,
) -> str:
    """Text of a URDF: links torch and part at the ends; joints: names of the arm's six (DH angles), tilt (B), turn (C).

    speeds: (8,) rad/s. Drawn is what `bodies` has, as cylinders, for the eye and for contacts. The positioner's turn is
    that of the part: -C - turn_zero stands in the fixed origin of `part`, so the joint is C itself, about -z.
    """
    arm = machine.arm
    drawn = _drawn(machine)
    parts = [f'<robot name="{name}">', _link('world', drawn)]
    before = np.eye(4)
    parent = 'world'
    for n, link in enumerate(arm.links):
        child = f'link{n + 1}'
        parts.append(_link(child, drawn))
        limits = (arm.low[n], arm.high[n], float(speeds[n]))
        parts.append(_joint(joints[n], parent, child, before, (0, 0, 1), limits))
        before = _end(link)
        parent = child
    parts += [_link(TORCH, drawn), _joint('tool', parent, TORCH, before @ arm.tool)]
    parts += _positioner(machine.positioner, speeds, drawn, joints[AXES:])
    return '\n'.join([*parts, '</robot>', ''])


def _end(link: Link) -> np.ndarray:
    """(4, 4): the end of a link in the frame that its joint turns."""
    return np.asarray(translation(link.a, 0.0, link.d) @ rotation(0, link.alpha))


def _positioner(
    p: Positioner, speeds: np.ndarray, drawn: dict[str, list[str]], joints: Sequence[str]
) -> list[str]:
    axis = p.faceplate(0.0).copy()
    axis[2, 3] -= p.d_c  # where the tilt axis is; B turns about -y
    limits = [(p.low[n], p.high[n], float(speeds[AXES + n])) for n in range(2)]
    return [
        _link('cradle', drawn),
        _joint(joints[0], 'world', 'cradle', axis, (0, -1, 0), limits[0]),
        _link('table', drawn),
        _joint(
            joints[1], 'cradle', 'table',
            translation(z=p.d_c) @ rotation(2, -p.turn_zero), (0, 0, -1), limits[1],
        ),
        _link(PART, drawn),
        _joint('faceplate', 'table', PART, np.eye(4)),
    ]  # fmt: skip


def _drawn(machine: Machine) -> dict[str, list[str]]:
    """Link -> the elements of its shapes."""
    bodies = bodies_of(machine.arm, machine.positioner)
    held = {0: ('world', np.eye(4)), TOOL: (TORCH, np.eye(4)), PART_FRAME: (PART, np.eye(4))}
    held[CRADLE] = ('cradle', translation(z=machine.positioner.d_c))
    held |= {n: (f'link{n}', _end(link)) for n, link in enumerate(machine.arm.links, 1)}
    found: dict[str, list[str]] = {}
    for c in bodies.capsules:
        link, frame = held[c.frame]
        found.setdefault(link, []).append(_cylinder(frame, np.array([c.a, c.b]), c.radius))
    for still in bodies.cylinders:
        link, frame = held[still.frame]
        line = np.array([[*still.centre, still.low], [*still.centre, still.high]])
        found.setdefault(link, []).append(_cylinder(frame, line, still.radius))
    return found


def _cylinder(frame: np.ndarray, line: np.ndarray, radius: float) -> str:
    """Around a line (2, 3), m, of a frame (4, 4) of the link."""
    a, b = line @ frame[:3, :3].T + frame[:3, 3]
    along = (b - a) / np.linalg.norm(b - a)
    pitch, yaw = np.arccos(np.clip(along[2], -1, 1)), np.arctan2(along[1], along[0])
    place = ' '.join(f'{v:.6g}' for v in (a + b) / 2)
    return (
        f'<origin xyz="{place}" rpy="0 {pitch:.6g} {yaw:.6g}"/><geometry><cylinder radius="{radius:.4g}" '
        f'length="{np.linalg.norm(b - a):.6g}"/></geometry>'
    )


def _link(name: str, drawn: dict[str, list[str]]) -> str:
    shapes = [
        f'    <{what}>{shape}</{what}>'
        for shape in drawn.get(name, [])
        for what in ('visual', 'collision')
    ]
    if not shapes:
        return f'  <link name="{name}"/>'
    return '\n'.join([f'  <link name="{name}">', *shapes, '  </link>'])


def _joint(
    name: str,
    parent: str,
    child: str,
    origin: np.ndarray,
    axis: tuple[int, int, int] | None = None,
    limits: tuple[float, float, float] | None = None,
) -> str:
    kind = 'fixed' if limits is None else 'revolute'
    place = ' '.join(repr(float(v)) for v in origin[:3, 3])
    turn = ' '.join(repr(float(v)) for v in wpr(origin))
    lines = [
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{parent}"/><child link="{child}"/>',
        f'    <origin xyz="{place}" rpy="{turn}"/>',
    ]
    if axis and limits:
        low, high, speed = limits
        lines.append(f'    <axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>')
        lines.append(
            f'    <limit lower="{low!r}" upper="{high!r}" velocity="{speed!r}" effort="1000.0"/>'
        )
    return '\n'.join([*lines, '  </joint>'])


# ---- checking ----------------------------------------------------------------------------------


def check_urdf(data: bytes | str) -> str:
    """The text, when every joint and link in it makes sense together. UrdfError with the line of what does not.

    Checked: XML without document types, root `robot`, known kinds of joints, parents and children that exist, one tree,
    finite origins, axes that are none, limits in order. What is drawn, masses and transmissions are not looked at.
    """
    raw = data.encode('utf-8', 'surrogatepass') if isinstance(data, str) else data
    if len(raw) > MAX_URDF_BYTES:
        raise UrdfError(f'{len(raw)} bytes; at most {MAX_URDF_BYTES}')
    checker = _Checker()
    try:
        checker.parser.Parse(raw, True)
    except expat.ExpatError as e:
        raise UrdfError(f'line {e.lineno}: {expat.errors.messages.get(e.code, "no XML")}') from None
    except (LookupError, ValueError) as e:
        if isinstance(e, UrdfError):
            raise
        raise UrdfError(f'line 1: cannot be read ({e})') from None
    checker.tree()
    try:
        return raw.decode('utf-8')
    except UnicodeDecodeError:
        raise UrdfError('the text is not UTF-8') from None


class _Checker:
    def __init__(self) -> None:
        self.links: dict[str, int] = {}
        self.joints: dict[str, dict[str, str]] = {}
        self.lines: dict[str, int] = {}
        self.depth: list[str] = []
        self.joint = ''
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype

    def fail(self, text: str, line: int = 0) -> UrdfError:
        return UrdfError(f'line {line or self.parser.CurrentLineNumber}: {text}')

    def _doctype(self, *_: object) -> None:
        raise self.fail('document types and entities are not read')

    def _end(self, _name: str) -> None:
        self.depth.pop()

    def _start(self, name: str, values: dict[str, str]) -> None:
        if len(self.depth) > 30:
            raise self.fail('elements are nested more than 30 deep')
        path = [*self.depth, name]
        self.depth.append(name)
        if len(path) == 1 and name != 'robot':
            raise self.fail(f"the root element is '{name}', wanted 'robot'")
        if path[1:] == ['link']:
            self._named(values, 'link', self.links)
            self.links[values['name']] = self.parser.CurrentLineNumber
        elif path[1:] == ['joint']:
            self._begin_joint(values)
        elif path[1:2] == ['joint'] and len(path) == 3:
            self._inside_joint(name, values)

    def _named(self, values: dict[str, str], what: str, known: dict) -> None:
        if not values.get('name', '').strip():
            raise self.fail(f'a {what} without a name')
        if values['name'] in known:
            raise self.fail(f"{what} '{values['name']}' is there twice")

    def _begin_joint(self, values: dict[str, str]) -> None:
        self._named(values, 'joint', self.joints)
        if len(self.joints) >= MAX_JOINTS:
            raise self.fail(f'more than {MAX_JOINTS} joints')
        self.joint = values['name']
        kind = values.get('type', '')
        if kind not in KINDS:
            raise self.fail(f"joint '{self.joint}': type '{kind}'; known are {', '.join(KINDS)}")
        self.joints[self.joint] = {'type': kind}
        self.lines[self.joint] = self.parser.CurrentLineNumber

    def _inside_joint(self, name: str, values: dict[str, str]) -> None:
        joint = self.joints[self.joint]
        if name in ('parent', 'child'):
            joint[name] = values.get('link', '')
        elif name == 'origin':
            self._numbers(values.get('xyz', '0 0 0'), 3, 'origin xyz')
            self._numbers(values.get('rpy', '0 0 0'), 3, 'origin rpy')
        elif name == 'axis':
            axis = self._numbers(values.get('xyz', '1 0 0'), 3, 'axis')
            if not np.linalg.norm(axis) > 1e-6:
                raise self.fail(f"joint '{self.joint}': an axis without direction")
        elif name == 'limit':
            joint['limit'] = 'given'
            low, high, speed = (
                self._numbers(values.get(key, '0'), 1, f'limit {key}')[0]
                for key in ('lower', 'upper', 'velocity')
            )
            if joint['type'] in ('revolute', 'prismatic') and not low < high:
                raise self.fail(f"joint '{self.joint}': limits {low:g} to {high:g}")
            if speed < 0:
                raise self.fail(f"joint '{self.joint}': a negative velocity limit")
        elif name == 'mimic':
            raise self.fail(f"joint '{self.joint}' mimics another one, which is not supported")

    def _numbers(self, text: str, count: int, what: str) -> list[float]:
        try:
            values = [float(v) for v in text.split()]
        except ValueError:
            values = []
        if len(values) != count or not np.isfinite(values).all() or max(map(abs, values)) > 1e9:
            raise self.fail(
                f"joint '{self.joint}': {what} is '{text[:40]}', wanted {count} numbers"
            )
        return values

    def tree(self) -> None:
        """Every joint connects links that exist, every link but one has one parent, nothing goes round."""
        parent: dict[str, str] = {}
        for name, joint in self.joints.items():
            line = self.lines[name]
            for end in ('parent', 'child'):
                if joint.get(end) not in self.links:
                    raise self.fail(
                        f"joint '{name}': no link '{joint.get(end, '')}' for its {end}", line
                    )
            if joint['type'] in ('revolute', 'prismatic') and 'limit' not in joint:
                raise self.fail(f"joint '{name}' has no limit", line)
            if joint['child'] in parent:
                raise self.fail(f"joint '{name}': link '{joint['child']}' has two parents", line)
            parent[joint['child']] = joint['parent']
        roots = [name for name in self.links if name not in parent]
        if len(roots) != 1:
            said = ', '.join(roots) or 'none, they go round'
            raise UrdfError(f'links without a parent: {said}; wanted one')
        for name in self.links:
            seen = {name}
            while name in parent:
                name = parent[name]
                if name in seen:
                    raise UrdfError(f"the joints go round through link '{name}'")
                seen.add(name)
