"""The arm of a simulated cell from a URDF: where its joints truly put the torch.

The transforms are those of the file, multiplied out here; the bridge computes with Pinocchio
(`waam_robot.urdf_station`), and tests compare the two. Only the check of the file is shared. Links `part` (its origin
`origin` before machine zero) and `torch` (z towards the part) are wanted; the first six joints are the arm, one or two
more between them a positioner that stands still. Frames are those of `Station.frames`: machine coordinates, the axes of
the machine where the torch is upright.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from waam_robot.urdf_text import PART, TORCH, UrdfError, check_urdf

ARM = 6  # joints that move the torch
MAX_JOINTS = ARM + 2  # with a positioner
OVER = np.diag([1.0, -1.0, -1.0])  # the torch looks at the part
TINY = 1e-6  # rad, for differences
POSE_TOLERANCE = 1e-9  # m and rad
STEPS = 60
MAX_SEARCH_STEP = 0.3  # rad, a step of the search
NONE = 1e-6  # m: a shorter length is none


@dataclass(frozen=True)
class Joint:
    """origin: (4, 4) in the frame of the joint before; axis: (3,) unit; low, high: rad; speed: rad/s, 0 = not told."""

    name: str
    origin: np.ndarray
    axis: np.ndarray
    low: float
    high: float
    speed: float


class Branch:
    """The joints from where arm and positioner part to `link`. lengths (n + 1, 3), m: those of another arm."""

    def __init__(self, joints: list[Joint], end: np.ndarray) -> None:
        self.joints = joints
        self._origins = np.array([*(j.origin for j in joints), end])
        skew = [_skew(j.axis) for j in joints]
        self._skew = np.array(skew).reshape(-1, 3, 3)
        self._square = self._skew @ self._skew
        self.lengths = self._origins[:, :3, 3]

    def frames(self, angles: np.ndarray, lengths: np.ndarray | None = None) -> np.ndarray:
        """(N, 4, 4) for angles (N, n), rad."""
        origins = self._origins.copy()
        if lengths is not None:
            origins[:, :3, 3] = lengths
        turned = np.zeros((*angles.shape, 4, 4))
        turned[..., 3, 3] = 1.0
        s, c = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
        turned[..., :3, :3] = np.eye(3) + s * self._skew + (1 - c) * self._square
        moved = origins[:-1] @ turned
        out = np.broadcast_to(np.eye(4), (len(angles), 4, 4))
        for n in range(len(self.joints)):
            out = out @ moved[:, n]
        return np.asarray(out @ origins[-1])


class UrdfArm:
    """names: joints in the order wanted; () = as in the file, the arm from its base on, then the positioner. posture:
    (n,) rad, near which the arm works, its torch about upright. UrdfError says what is wrong in the file."""

    def __init__(
        self,
        text: bytes | str,
        posture: tuple[float, ...],
        names: tuple[str, ...] = (),
        origin: tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> None:
        self._arm, self._table = branches(text)
        inner = [*self._arm.joints, *self._table.joints]
        known = tuple(j.name for j in inner)
        self.names = names or known
        if sorted(self.names) != sorted(known):
            wrong = ', '.join(sorted(set(self.names) ^ set(known)) or self.names)
            raise UrdfError(f'its joints are {", ".join(known)}; wanted or left over: {wrong}')
        self._order = [self.names.index(name) for name in known]  # of the chain in the names
        if len(posture) != len(known):
            raise UrdfError(f'a posture of {len(posture)} values for {len(known)} joints')
        by_name = {j.name: j for j in inner}
        self.low = np.array([by_name[n].low for n in self.names])
        self.high = np.array([by_name[n].high for n in self.names])
        self._origin = np.array(origin, float)
        self._posture = np.array(posture, float)
        self._upright = np.eye(3)
        self._upright = _spin(self.frames(self._posture[None])[0, :3, :3] @ OVER) @ OVER

    def frames(self, joints: np.ndarray, lengths: np.ndarray | None = None) -> np.ndarray:
        """(N, 4, 4) of the torch for joints (N, n). lengths: those of an arm with errors."""
        chain = np.asarray(joints, float)[:, self._order]
        split = len(self._arm.joints)
        table = np.linalg.inv(self._table.frames(chain[:, split:]))
        out = np.asarray(table @ self._arm.frames(chain[:, :split], lengths))
        out[:, :3, :3] = out[:, :3, :3] @ self._upright.T
        out[:, :3, 3] -= self._origin
        return out

    def tips(self, joints: np.ndarray) -> np.ndarray:
        """(N, 3) m: the torch in machine coordinates for joints (N, n)."""
        return self.frames(joints)[:, :3, 3]

    def joints(self, tips: np.ndarray) -> np.ndarray:
        """(N, n): the arm with the torch upright at tips (N, 3), m, each from the one before, the first from the
        posture. UrdfError where it is not there within the limits."""
        out, q = [], self._posture
        for tip in np.asarray(tips, float):
            q = self._solve(q, tip)
            if said := self.beyond(q[None]):
                raise UrdfError(f'{_where(tip)}: {said}')
            out.append(q)
        return np.array(out)

    def beyond(self, joints: np.ndarray) -> str:
        """Which of joints (N, n) is beyond its limit first; '' = none."""
        out = np.argwhere(
            (joints < self.low - POSE_TOLERANCE) | (joints > self.high + POSE_TOLERANCE)
        )
        if not len(out):
            return ''
        row, n = out[0]
        at, low, high = joints[row, n], self.low[n], self.high[n]
        return f'{self.names[n]} would be {at:.4f}, its range {low:.4f} to {high:.4f}'

    def lengthened(self, sigma: float, rng: np.random.Generator) -> np.ndarray:
        """Lengths (n, 3), m, of an arm with errors of those that it has, behind the first joint."""
        lengths = self._arm.lengths.copy()
        off = rng.normal(0, sigma, lengths.shape) * (np.abs(lengths) > NONE)
        off[0] = 0.0  # where it stands on the floor
        return np.asarray(lengths + off)

    def _solve(self, q: np.ndarray, tip: np.ndarray) -> np.ndarray:
        moving = [self._order[n] for n in range(ARM)]
        steps = np.zeros((ARM, len(q)))
        steps[np.arange(ARM), moving] = TINY
        for _ in range(STEPS):
            frames = self.frames(np.vstack([q, q + steps]))
            here, turn = frames[0, :3, 3], frames[0, :3, :3]
            off = np.concatenate([tip - here, -_turns(turn[None])[0]])
            if np.abs(off).max() < POSE_TOLERANCE:
                return q
            turns = _turns(frames[1:, :3, :3] @ turn.T)
            j = np.column_stack([frames[1:, :3, 3] - here, turns]).T / TINY
            step = np.linalg.lstsq(j, off, rcond=1e-6)[0]
            q = q.copy()
            q[moving] += step * min(1.0, MAX_SEARCH_STEP / max(float(np.abs(step).max()), 1e-12))
        raise UrdfError(f'{_where(tip)} is not reached from the posture')


# ---- the file


def branches(text: bytes | str) -> tuple[Branch, Branch]:
    """Arm and positioner of a URDF: from the link that both stand on to `torch` and to `part`."""
    root = ElementTree.fromstring(check_urdf(text))  # checked: no document types, one tree
    above = {j.find('child').get('link'): j for j in root.iterfind('joint')}  # type: ignore[union-attr]
    links = {link.get('name') for link in root.iterfind('link')}
    for name in (TORCH, PART):
        if name not in links:
            raise UrdfError(f"no link '{name}'; there are {', '.join(sorted(map(str, links)))}")
    arm, table = _up(above, TORCH), _up(above, PART)
    while arm and table and arm[0] is table[0]:
        arm, table = arm[1:], table[1:]
    moving = [j.get('name', '') for j in root.iterfind('joint') if j.get('type') != 'fixed']
    used = [j.get('name', '') for j in (*arm, *table)]
    if idle := [name for name in moving if name not in used]:
        raise UrdfError(
            f"joint '{idle[0]}' moves, but is not between the links '{PART}' and '{TORCH}'"
        )
    found = _branch(arm), _branch(table)
    count = len(found[0].joints)
    if count != ARM or count + len(found[1].joints) > MAX_JOINTS:
        raise UrdfError(
            f"{count} revolute joints move the link '{TORCH}' and {len(found[1].joints)} the link '{PART}'; "
            f'wanted are {ARM}, and at most {MAX_JOINTS - ARM}'
        )
    return found


def _up(above: dict, link: str) -> list[ElementTree.Element]:
    """The joints from the root to a link."""
    out = []
    while link in above:
        out.append(above[link])
        link = above[link].find('parent').get('link')
    return out[::-1]


def _branch(elements: list[ElementTree.Element]) -> Branch:
    joints, before = [], np.eye(4)
    for element in elements:
        name, kind = element.get('name', ''), element.get('type')
        before = before @ _origin(element)
        if kind == 'fixed':
            continue
        if kind != 'revolute':
            raise UrdfError(f"joint '{name}' is {kind}; those of an arm are revolute, with limits")
        axis = np.array(_numbers(element, 'axis', 'xyz', '1 0 0'))
        low, high, speed = (
            _numbers(element, 'limit', key, '0')[0] for key in ('lower', 'upper', 'velocity')
        )
        joints.append(Joint(name, before, axis / np.linalg.norm(axis), low, high, speed))
        before = np.eye(4)
    return Branch(joints, before)


def _origin(element: ElementTree.Element) -> np.ndarray:
    out = np.eye(4)
    for axis, angle in zip(np.eye(3), _numbers(element, 'origin', 'rpy', '0 0 0'), strict=True):
        out[:3, :3] = _about(axis, angle) @ out[:3, :3]
    out[:3, 3] = _numbers(element, 'origin', 'xyz', '0 0 0')
    return out


def _numbers(element: ElementTree.Element, child: str, key: str, usual: str) -> list[float]:
    found = element.find(child)
    return [float(v) for v in (usual if found is None else found.get(key, usual)).split()]


def _skew(v: np.ndarray) -> np.ndarray:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _spin(turn: np.ndarray) -> np.ndarray:
    """(3, 3): about z, as much as a rotation turns x."""
    return _about(np.array([0.0, 0.0, 1.0]), float(np.arctan2(turn[1, 0], turn[0, 0])))


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3): a turn about an axis (3,) of length 1."""
    k = _skew(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def _turns(turned: np.ndarray) -> np.ndarray:
    """(N, 3) rad of rotations (N, 3, 3) by less than half a turn."""
    across = (
        np.stack([turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1) / 2
    )
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, (np.trace(turned, axis1=1, axis2=2) - 1) / 2)
    return np.asarray(
        across * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-12)[:, None]
    )


def _where(tip: np.ndarray) -> str:
    return '(' + ', '.join(f'{v * 1e3:.0f}' for v in tip) + ') mm'
