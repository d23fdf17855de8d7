"""What takes up room in a robot cell from a URDF: the simple shapes of its links, as `bodies` has them, and frames.

Shapes of `collision` count, those of `visual` where a link has none. On the arm, cylinders, boxes and balls become
capsules around them, so round ends stand out; under the part they stay what they are. Meshes are left out and named.
A link `torch` without a shape gets the nozzle of `bodies.TORCH`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from xml.etree import ElementTree

import numpy as np

from .arm import AXES
from .bodies import CRADLE, FRAMES, PART, TOOL, Block, Bodies, Capsule, ends
from .bodies import TORCH as NOZZLE
from .frames import inverse, rotation, translation
from .urdf_arm import UrdfChain
from .urdf_text import PART as PART_LINK
from .urdf_text import TORCH as TORCH_LINK
from .urdf_text import UrdfError, check_urdf

ALONG = np.linspace(0.0, 1.0, 33)  # of a capsule, for what touches in the posture given
SHAPES = ('box', 'cylinder', 'sphere')


@dataclass(frozen=True)
class _Shape:
    """size: as `Block.size`; place: (4, 4) in the frame of its link."""

    link: str
    kind: str
    size: tuple[float, ...]
    place: np.ndarray


class UrdfCell:
    """names: of the joints, in the order of the driver. posture: (n,) rad, links that touch there are taken as joined.

    `bodies`: six links and the torch as capsules, all else as blocks; `left_out`: links whose shapes are meshes.
    UrdfError where not six joints move the torch and at most two the part.
    """

    def __init__(
        self, text: bytes | str, names: tuple[str, ...], posture: np.ndarray | None = None
    ) -> None:
        self._chain = UrdfChain(text)
        known = self._chain.names
        if sorted(known) != sorted(names):
            raise UrdfError(f'its joints are {", ".join(known)}; named are {", ".join(names)}')
        self._order = np.array([known.index(n) for n in names])
        root = ElementTree.fromstring(check_urdf(text))  # checked: no document types, one tree
        above: dict[str, ElementTree.Element] = {}
        for joint in root.iterfind('joint'):
            above[str(joint.find('child').get('link'))] = joint  # type: ignore[union-attr]
        arm, table = _moving(above, TORCH_LINK), _moving(above, PART_LINK)
        if len(arm) != AXES or len(table) > 2 or set(arm) & set(table):
            raise UrdfError(
                f"{len(arm)} joints move the link '{TORCH_LINK}' and {len(table)} the link '{PART_LINK}'; for "
                f'contacts and pictures these are {AXES} and at most 2, none of them in both'
            )
        base = next(
            link.get('name', '') for link in root.iterfind('link') if link.get('name') not in above
        )
        self._links = _links_of_frames(base, arm, table, above)
        shapes, self.left_out = _shapes(root)
        self.bodies = self._bodies(shapes, above, arm, table)
        if posture is not None:
            frames = self.frames(np.asarray(posture, float)[None])
            self.bodies = replace(self.bodies, capsules=_joined(self.bodies.capsules, frames))

    def frames(self, joints: np.ndarray) -> np.ndarray:
        """(N, FRAMES, 4, 4) in the frame of the first link, numbered as in `bodies`, for joints (N, n)."""
        inner = np.empty_like(np.asarray(joints, float))
        inner[:, self._order] = joints
        return self._chain.placements(inner, self._links)

    def _bodies(
        self,
        shapes: list[_Shape],
        above: dict[str, ElementTree.Element],
        arm: dict[str, str],
        table: dict[str, str],
    ) -> Bodies:
        still = np.zeros((1, len(self._order)))
        frames = self._chain.placements(still, self._links)[0]
        capsules, blocks = [], []
        for shape in shapes:
            joints = _moving(above, shape.link)
            on_arm = [n for n, name in enumerate(arm, 1) if name in joints]
            under = [n for n, name in enumerate(table, 1) if name in joints]
            frame = _frame(on_arm, under, len(table))
            link = self._chain.placements(still, (shape.link,))[0, 0]
            held = replace(shape, place=inverse(frames[frame]) @ link @ shape.place)
            if on_arm:
                capsules.append(_capsule(held, frame))
            else:
                blocks.append(Block(held.link, frame, held.kind, held.size, held.place))
        if all(shape.link != TORCH_LINK for shape in shapes):
            capsules.append(NOZZLE[0])
        return Bodies(tuple(capsules), (), tuple(blocks))


def _moving(above: dict[str, ElementTree.Element], link: str) -> dict[str, str]:
    """Joint that moves a link -> the link behind it, from the base on."""
    found = []
    while link in above:
        joint = above[link]
        if joint.get('type') != 'fixed':
            found.append((joint.get('name', ''), link))
        link = joint.find('parent').get('link')  # type: ignore[union-attr, assignment]
    return dict(found[::-1])


def _links_of_frames(
    base: str, arm: dict[str, str], table: dict[str, str], above: dict[str, ElementTree.Element]
) -> tuple[str, ...]:
    """(FRAMES,) the link whose frame each frame of `bodies` is."""
    out = [base] * FRAMES
    out[1 : AXES + 1] = arm.values()
    out[TOOL], out[PART] = TORCH_LINK, PART_LINK
    if table:
        out[CRADLE] = next(iter(table.values()))
    return tuple(out)


def _frame(on_arm: list[int], under: list[int], table: int) -> int:
    """The frame that a link moves with: that of its last joint."""
    if on_arm:
        return on_arm[-1]
    if not under:
        return 0
    return CRADLE if table == 2 and under[-1] == 1 else PART


def _shapes(root: ElementTree.Element) -> tuple[list[_Shape], tuple[str, ...]]:
    """Those that are boxes, cylinders and balls, and the links that have others."""
    found, left_out = [], []
    for link in root.iterfind('link'):
        name = link.get('name', '')
        for element in link.findall('collision') or link.findall('visual'):
            geometry = element.find('geometry')
            what = None if geometry is None else next(iter(geometry), None)
            if what is None or what.tag not in SHAPES:
                left_out.append(name)
                continue
            found.append(_Shape(name, what.tag, _size(name, what), _origin(name, element)))
    return found, tuple(dict.fromkeys(left_out))


def _size(link: str, what: ElementTree.Element) -> tuple[float, ...]:
    if what.tag == 'box':
        return _numbers(link, what.get('size', ''), 3, 'size')
    radius = _numbers(link, what.get('radius', ''), 1, 'radius')
    length = _numbers(link, what.get('length', ''), 1, 'length') if what.tag == 'cylinder' else ()
    return (*radius, *length)


def _origin(link: str, element: ElementTree.Element) -> np.ndarray:
    origin = element.find('origin')
    xyz, rpy = (
        _numbers(link, '0 0 0' if origin is None else origin.get(key, '0 0 0'), 3, key)
        for key in ('xyz', 'rpy')
    )
    turned = rotation(2, rpy[2]) @ rotation(1, rpy[1]) @ rotation(0, rpy[0])
    return np.asarray(translation(*xyz) @ turned)


def _numbers(link: str, text: str, count: int, what: str) -> tuple[float, ...]:
    try:
        values = tuple(float(v) for v in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise UrdfError(
            f"link '{link}': {what} of a shape is '{text[:40]}', wanted {count} numbers"
        )
    return values


def _capsule(shape: _Shape, frame: int) -> Capsule:
    """Around a shape."""
    if shape.kind == 'box':
        order = np.argsort(shape.size)
        across, long = float(np.linalg.norm(np.array(shape.size)[order[:2]])) / 2, int(order[2])
        half, radius = np.eye(3)[long] * shape.size[long] / 2, across
    else:
        half, radius = np.array([0.0, 0.0, (*shape.size, 0.0)[1] / 2]), shape.size[0]
    a, b = (shape.place[:3, :3] @ (sign * half) + shape.place[:3, 3] for sign in (-1, 1))
    return Capsule(shape.link, frame, _point(a), _point(b), radius, frame - 1)


def _point(v: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, v)
    return (x, y, z)


def _joined(capsules: tuple[Capsule, ...], frames: np.ndarray) -> tuple[Capsule, ...]:
    """The capsules, joined to the lowest link that they touch in a posture, frames (1, FRAMES, 4, 4)."""
    lines = ends(capsules, frames)[0]
    points = lines[:, :1] + ALONG[:, None] * (lines[:, 1:] - lines[:, :1])  # (K, 33, 3)
    out = []
    for k, capsule in enumerate(capsules):
        apart = np.linalg.norm(points[k, None, :, None] - points[:, None], axis=-1).min(axis=(1, 2))
        touching = [
            other.link
            for other, free in zip(capsules, apart, strict=True)
            if other.link < capsule.link and free < capsule.radius + other.radius
        ]
        out.append(replace(capsule, near=min([capsule.near, capsule.link - 1, *touching])))
    return tuple(out)
