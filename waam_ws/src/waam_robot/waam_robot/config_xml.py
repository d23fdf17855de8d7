"""The robot description of source 003 (section 3.3): a chain of segments in XML, its reader and writer.

A segment is a joint and then the product of its frames. Angles in rad, lengths in the file in mm, here in m. Inside a
frame Alfa, Beta, Gamma turn about x, y, z (Rz Ry Rx), then X, Y, Z shift, as in KDL, which the source uses. The world
lies on the level of joint 2 (d1 = 0).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .arm import AXES, PATTERN, Arm, ArmError, Link
from .frames import pose_from_wpr, rotation, wpr
from .xml_tree import Element, XmlError, parse

MM = 1e-3
FREE = 1e5  # the source's default of MinAngle and MaxAngle: no limit
KINDS = ('None', 'Fixed', 'RotX', 'RotY', 'RotZ')
FRAME_FIELDS = ('Alfa', 'Beta', 'Gamma', 'X', 'Y', 'Z')
MOST_SEGMENTS, MOST_FRAMES = 50, 20
ANGLE_MOST, LENGTH_MOST = 1e5, 1e6  # rad, mm
SERIAL = ('RotZ', 'RotY', 'RotY', 'RotX', 'RotY', 'RotX')
SIGNS = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0])  # RotY turns against z of the DH frames
ZERO = np.array(
    [0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0]
)  # DH angles where all angles of the file are 0
TIP = rotation(1, -np.pi / 2) @ rotation(0, np.pi)  # axes of the DH flange in the file's last frame
SAME = 1e-6  # rad or m; files are printed with some twelve digits


@dataclass(frozen=True)
class Frame:
    """angles: about x, y, z in rad; shift: (3,) in m."""

    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> np.ndarray:
        return pose_from_wpr(np.array(self.shift), np.array(self.angles))


@dataclass(frozen=True)
class Segment:
    """kind: 'Fixed' ('None' in files) or 'RotX', 'RotY', 'RotZ'; limits in rad."""

    kind: str
    low: float = -FREE
    high: float = FREE
    frames: tuple[Frame, ...] = ()

    @property
    def moves(self) -> bool:
        return self.kind.startswith('Rot')

    @property
    def pose(self) -> np.ndarray:
        """(4, 4): product of the frames."""
        out = np.eye(4)
        for frame in self.frames:
            out = out @ frame.pose
        return out


@dataclass(frozen=True)
class Chain:
    """Segments from the base to the tip."""

    segments: tuple[Segment, ...] = field(default_factory=tuple)

    @property
    def joints(self) -> tuple[Segment, ...]:
        return tuple(s for s in self.segments if s.moves)

    def forward(self, angles: np.ndarray) -> np.ndarray:
        """(..., 4, 4): the tip, for angles (..., number of joints) as the file counts them."""
        angles = np.asarray(angles, float)
        if angles.shape[-1:] != (len(self.joints),):
            raise ValueError(
                f'the chain has {len(self.joints)} joints, not {angles.shape[-1:] or 0}'
            )
        pose: np.ndarray = np.broadcast_to(np.eye(4), (*angles.shape[:-1], 4, 4))
        n = 0
        for segment in self.segments:
            if segment.moves:
                pose = pose @ rotation('XYZ'.index(segment.kind[-1]), angles[..., n])
                n += 1
            pose = pose @ segment.pose
        return pose

    def beyond(self, angles: np.ndarray) -> str:
        """Which of angles (joints,) are beyond their limits; empty where none is."""
        return '; '.join(
            f'J{n} = {a:.4f} rad is outside {s.low:.4f} to {s.high:.4f}'
            for n, (a, s) in enumerate(zip(angles, self.joints, strict=True), 1)
            if not s.low <= a <= s.high
        )


# ---- reading -----------------------------------------------------------------------------------


def read(data: bytes | str) -> Chain:
    """XmlError with the line for everything that is no such chain."""
    root = parse(data)
    if root.name != 'Segments':
        raise XmlError(root.line, f"the root element is '{root.name}', wanted 'Segments'")
    if len(root.inner) > MOST_SEGMENTS:
        raise XmlError(root.line, f'{len(root.inner)} segments; at most {MOST_SEGMENTS}')
    if not root.inner:
        raise XmlError(root.line, 'no Segment in it')
    return Chain(tuple(_segment(e) for e in root.inner))


def _segment(element: Element) -> Segment:
    _expect(element, 'Segment')
    if len(element.inner) > MOST_FRAMES:
        raise XmlError(element.line, f'more than {MOST_FRAMES} elements in a Segment')
    frames = tuple(_frame(e) for e in element.inner if e.name == 'Frame')
    single = _single(element, ('JointType', 'MinAngle', 'MaxAngle'), repeated=('Frame',))
    if 'JointType' not in single:
        raise XmlError(element.line, 'Segment without JointType')
    kind = single['JointType'].text.strip()
    if kind not in KINDS:
        raise XmlError(
            single['JointType'].line, f"JointType '{kind}'; known are {', '.join(KINDS)}"
        )
    low = _number(single.get('MinAngle'), -FREE, ANGLE_MOST)
    high = _number(single.get('MaxAngle'), FREE, ANGLE_MOST)
    if low >= high:
        raise XmlError(element.line, f'MinAngle {low:g} is not below MaxAngle {high:g}')
    return Segment('Fixed' if kind == 'None' else kind, low, high, frames)


def _frame(element: Element) -> Frame:
    single = _single(element, FRAME_FIELDS)
    angle = [_number(single.get(name), 0.0, ANGLE_MOST) for name in FRAME_FIELDS[:3]]
    shift = [_number(single.get(name), 0.0, LENGTH_MOST) * MM for name in FRAME_FIELDS[3:]]
    return Frame((angle[0], angle[1], angle[2]), (shift[0], shift[1], shift[2]))


def _single(
    element: Element, names: tuple[str, ...], repeated: tuple[str, ...] = ()
) -> dict[str, Element]:
    """Inner elements by name, each at most once and known."""
    found: dict[str, Element] = {}
    for inner in element.inner:
        if inner.name in repeated:
            continue
        if inner.name not in names:
            raise XmlError(
                inner.line,
                f"'{inner.name}' in {element.name}; known are {', '.join((*names, *repeated))}",
            )
        if inner.name in found:
            raise XmlError(inner.line, f'{inner.name} is given twice')
        found[inner.name] = inner
    return found


def _expect(element: Element, name: str) -> None:
    if element.name != name:
        raise XmlError(element.line, f"'{element.name}', wanted '{name}'")


def _number(element: Element | None, default: float, most: float) -> float:
    if element is None:
        return default
    text = element.text.strip()
    try:
        value = float(text)
    except ValueError:
        raise XmlError(element.line, f"{element.name} is '{text[:40]}', no number") from None
    if not abs(value) <= most:
        raise XmlError(element.line, f'{element.name} is {text[:40]}; at most {most:g} either way')
    return value


# ---- writing -----------------------------------------------------------------------------------


def write(chain: Chain) -> str:
    """The file's text; `read` gives the same chain back, to the last bit but for the rounding of mm to m."""
    lines = ['<Segments>']
    for segment in chain.segments:
        lines += ['  <Segment>', f'    <JointType>{segment.kind}</JointType>']
        lines += _limit('MinAngle', segment.low, -FREE) + _limit('MaxAngle', segment.high, FREE)
        for frame in segment.frames:
            values = (*frame.angles, *(v / MM for v in frame.shift))
            named = zip(FRAME_FIELDS, values, strict=True)
            lines += [
                '    <Frame>',
                *(f'      <{n}>{_text(v)}</{n}>' for n, v in named),
                '    </Frame>',
            ]
        lines.append('  </Segment>')
    return '\n'.join([*lines, '</Segments>', ''])


def _limit(name: str, value: float, default: float) -> list[str]:
    return [] if value == default else [f'    <{name}>{value!r}</{name}>']


def _text(value: float) -> str:
    """At least twelve digits, without the noise of mm to m."""
    return repr(float(f'{value:.15g}'))


# ---- the arm in it -----------------------------------------------------------------------------


def to_file(theta: np.ndarray) -> np.ndarray:
    """(..., 6) angles as the file counts them (J2 = 0 upright, serial), from DH angles."""
    return SIGNS * (np.asarray(theta, float) - ZERO)


def from_file(angles: np.ndarray) -> np.ndarray:
    """(..., 6) DH angles from those of the file."""
    return SIGNS * np.asarray(angles, float) + ZERO


def chain_of(arm: Arm) -> Chain:
    """The arm as the source's file has it: world on the level of joint 2, last segment fixed: flange and tool."""
    a1, a2, a3 = (arm.links[n].a for n in range(3))
    d4, d6 = arm.links[3].d, arm.links[5].d
    shifts = ((a1, 0, 0), (0, 0, a2), (0, 0, a3), (d4, 0, 0), (0, 0, 0), (d6, 0, 0))
    ends = np.sort(to_file(np.array([arm.low, arm.high])), axis=0)
    moving = [
        Segment(kind, float(low), float(high), (Frame(shift=_three(shift)),))
        for kind, low, high, shift in zip(SERIAL, ends[0], ends[1], shifts, strict=True)
    ]
    flange = TIP @ arm.tool
    last = Frame(_three(wpr(flange)), _three(flange[:3, 3]))
    return Chain((*moving, Segment('Fixed', frames=(last,))))


def arm_of(chain: Chain, name: str = 'robot.xml') -> Arm:
    """The arm of a file whose chain has an analytic inverse. ArmError that says what is different."""
    kinds = tuple(s.kind for s in chain.joints)
    if kinds != SERIAL:
        raise ArmError(
            f'{name}: joints are {" ".join(kinds) or "none"}; the analytic inverse wants {" ".join(SERIAL)}. '
            'Describe other arms by a URDF'
        )
    if not chain.segments[0].moves:
        raise ArmError(f'{name}: the first segment has to be joint 1')
    poses = _after_joints(chain)
    wants: tuple[tuple[str, Callable[[np.ndarray], np.ndarray]], ...] = (
        ('X and Z', lambda p: p * [1, 0, 1]),
        ('Z', lambda p: p * [0, 0, 1]),
        ('X and Z', lambda p: p * [1, 0, 1]),
        ('X', lambda p: p * [1, 0, 0]),
        ('nothing', lambda p: p * 0),
    )
    for n, (axes, part) in enumerate(wants):
        shift = poses[n][:3, 3]
        if np.abs(poses[n][:3, :3] - np.eye(3)).max() > SAME:
            raise ArmError(
                f'{name}: frames behind joint {n + 1} turn; the analytic inverse wants shifts'
            )
        if np.abs(shift - part(shift)).max() > SAME:
            raise ArmError(
                f'{name}: frames behind joint {n + 1} shift by {np.round(shift / MM, 3)} mm; '
                f'the analytic inverse wants {axes} only'
            )
    return _arm(chain, poses, name)


def _arm(chain: Chain, poses: list[np.ndarray], name: str) -> Arm:
    a = (poses[0][0, 3], poses[1][2, 3], poses[2][2, 3])
    d = (poses[0][2, 3], 0.0, 0.0, poses[2][0, 3] + poses[3][0, 3], 0.0, 0.0)
    lengths = zip(d, (*a, 0.0, 0.0, 0.0), PATTERN, strict=True)
    links = tuple(Link(float(d), float(a), alpha) for d, a, alpha in lengths)
    limits = np.array([[s.low, s.high] for s in chain.joints]).T
    ends = np.sort(from_file(limits), axis=0)
    tool = TIP.T @ poses[5]  # TIP is a pure rotation; d6 is part of the tool here
    return Arm(links, tool, tuple(map(float, ends[0])), tuple(map(float, ends[1])), name=name)


def _after_joints(chain: Chain) -> list[np.ndarray]:
    """The fixed motion behind each of the six joints."""
    out = [np.eye(4)] * AXES
    n = -1
    for segment in chain.segments:
        n += segment.moves
        out[n] = out[n] @ segment.pose
    return out


def _three(values: object) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.asarray(values))
    return x, y, z
