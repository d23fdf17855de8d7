"""The cell's box before an arm of any kind, from a URDF: torch positions in machine coordinates <-> joints.

By Pinocchio, as `station.Station`: the torch is upright on the part, its spin and everything behind the first six
joints stand still, and one way of reaching serves the whole box. It is found once, from a posture that is given or from
random ones, and followed from point to point by Newton steps, so nothing can flip where no step is large.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from .arm import AXES
from .frames import translation
from .station import StationError
from .urdf_arm import UrdfChain
from .urdf_text import PART, TORCH, UrdfError

POSE_TOLERANCE = 1e-9  # m and rad
NEXT = 3e-6  # m and rad: from there one Newton step leads closer than POSE_TOLERANCE (its error grows with the square)
SMOOTH = 0.05  # rad between places whose difference leads on to the next place
STEPS, STEP_MAX = 40, 0.5  # Newton steps, and rad of a joint in one
TINY = 1e-5  # rad and m, for slopes
GRID = 50e-3  # m between the places of the box that are tried
MIN_SINGULAR_VALUE = (
    0.02  # smallest singular value of the Jacobian, m/rad: nearer to a singularity is not used
)
SPINS, STARTS = 6, 8
MIN_LIMIT_SHARE = 0.3  # share of a half range to every limit at which no other start is tried
FLIP = 0.6  # rad between neighbouring places of the box


@dataclass(frozen=True)
class UrdfPlace:
    """joint_names: in the order of the driver, six that move first, the others stand still; origin: (3,) m, machine
    zero in the frame of the link `part`; low, high: (3,) m, the box; posture: (n,) rad or m, joints near which the arm
    works, the torch's spin is as there; empty = one is searched for."""

    joint_names: tuple[str, ...]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    low: tuple[float, float, float] = (0.0, 0.0, 0.0)
    high: tuple[float, float, float] = (0.4, 0.3, 0.2)
    posture: tuple[float, ...] = ()
    torch: str = TORCH
    part: str = PART


class UrdfStation:
    """`joints` and `tips` as of `Station`; `text`: of the file. UrdfError for a bad file or wrong names, StationError
    for a place of the box that the arm does not reach."""

    def __init__(self, text: bytes | str, place: UrdfPlace) -> None:
        self.place, self.text = place, text
        self._chain = UrdfChain(text, place.torch, place.part)
        self._order = self._ordered()
        self._moving = self._order[:AXES]
        self._origin = np.array(place.origin, float)
        low, high = np.array(place.low, float), np.array(place.high, float)
        if not (low < high).all():
            raise StationError(f'the box from {place.low} to {place.high} m is empty')
        self._hold = np.clip(0.0, self._chain.low, self._chain.high)
        self._turn, self.middle = self._found(low, high)

    def joints(self, tips: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """(N, n) in the order of the names, for torch positions (N, 3), m, machine coordinates, each solved from the
        one before. near: (n,) where the arm is. StationError beside the arm's reach."""
        q = self.middle if near is None else self._inner(np.asarray(near, float))
        out = np.empty((len(tips), len(self._order)))
        step = np.zeros_like(q)
        for n, tip in enumerate(np.asarray(tips, float)):
            solved = self._solve(q + step, tip)
            if solved is None and n == 0:  # from far away
                solved = self._solve(self.middle, tip)
            if solved is None:
                raise StationError(f'{_where(tip)} mm is out of reach')
            step = solved - q if n and np.abs(solved - q).max() < SMOOTH else step * 0.0
            q = solved
            out[n] = q[self._order]
        return out

    def tips(self, joints: np.ndarray) -> np.ndarray:
        """(N, 3) m: the torch in machine coordinates for joints (N, n)."""
        inner = np.array([self._inner(q) for q in np.asarray(joints, float)])
        return self._chain.forward(inner)[:, :3, 3] - self._origin

    @property
    def machine_on_part(self) -> np.ndarray:
        """As `Station.machine_on_part`."""
        return translation(*self._origin)

    @property
    def tip_on_torch(self) -> np.ndarray:
        """As `Station.tip_on_torch`."""
        out = np.eye(4)
        out[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ self._turn.T
        return out

    @cached_property
    def gains(self) -> np.ndarray:
        """As `Station.gains`."""
        q, most = self.middle, np.zeros(len(self._order))
        for tip in _through(np.array(self.place.low, float), np.array(self.place.high, float)):
            solved = self._solve(q, tip)
            q = q if solved is None else solved  # the box was walked through at the start
            moving = self._chain.pose_and_jacobian(q)[1][:, self._moving]
            most[:AXES] = np.maximum(
                most[:AXES], np.linalg.norm(np.linalg.inv(moving)[:, :3], axis=1)
            )
        return most

    # ---- setting up

    def _ordered(self) -> np.ndarray:
        """Where each of the driver's joints is in the chain."""
        names, known = self.place.joint_names, self._chain.names
        if len(names) < AXES:
            raise UrdfError(f'{len(names)} joint names; an arm needs {AXES}')
        for name in names:
            if name not in known:
                raise UrdfError(f"no joint '{name}' that moves; there are {', '.join(known)}")
        missing = [n for n in known if n not in names]
        if missing:
            raise UrdfError(f"joint '{missing[0]}' moves, but is not among the joint names")
        if self.place.posture and len(self.place.posture) != len(names):
            raise UrdfError(
                f'a posture of {len(self.place.posture)} values for {len(names)} joints'
            )
        return np.array([known.index(n) for n in names])

    def _inner(self, joints: np.ndarray) -> np.ndarray:
        q = np.empty(len(self._order))
        q[self._order] = joints
        return q

    def _found(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((3, 3) the torch on the part, joints of the middle of the box) of the start that serves the whole box and
        stays farthest from the limits; StationError with the place that the best one does not reach."""
        best, least = None, -1.0
        failed: tuple[int, str] = (-1, 'no start was found: is the box where the arm can reach it?')
        for turn, start in self._starts():
            self._turn = turn
            middle = self._solve(start, (low + high) / 2)
            if middle is None or self._beyond(middle):
                continue
            seen, margin, said = self._serves(middle, low, high)
            if said:
                failed = max(failed, (seen, said))
            elif margin > least:
                best, least = (turn, middle), margin
            if least > MIN_LIMIT_SHARE:
                break
        if best is None:
            raise StationError(f'the robot does not reach all of its box: {failed[1]}')
        return best

    def _starts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        if self.place.posture:
            q = self._inner(np.array(self.place.posture, float))
            self._hold = q
            pose = self._chain.forward(q[None])[0, :3, :3]
            return [(_spun(float(np.arctan2(pose[1, 0], pose[0, 0]))), q)]
        rng, out = np.random.default_rng(1), []
        low, high = np.maximum(self._chain.low, -np.pi), np.minimum(self._chain.high, np.pi)
        for spin in np.arange(SPINS) * 2 * np.pi / SPINS:
            for q in rng.uniform(low, high, (STARTS, len(low))):
                q[self._order[AXES:]] = self._hold[self._order[AXES:]]
                out.append((_spun(spin), q))
        return out

    def _serves(
        self, middle: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[int, float, str]:
        """(places reached, least share of a half range to a limit, why it ends there)."""
        q, margin = middle, 1.0
        for n, tip in enumerate(_through(low, high)):
            solved = self._solve(q, tip)
            if solved is None:
                return n, margin, f'{_where(tip)} mm is out of reach'
            said = self._beyond(solved) or self._flips(q, solved)
            if said:
                return n, margin, f'at {_where(tip)} mm {said}'
            q = solved
            room = np.minimum(q - self._chain.low, self._chain.high - q)[self._moving]
            half = (self._chain.high - self._chain.low)[self._moving] / 2
            margin = min(margin, float((room / half).min()))
        return n + 1, margin, ''

    def _beyond(self, q: np.ndarray) -> str:
        said = self._chain.beyond(q)
        if said:
            return said
        size = float(
            np.linalg.svd(self._chain.pose_and_jacobian(q)[1][:, self._moving], compute_uv=False)[
                -1
            ]
        )
        return (
            f'it is too near to a singularity ({size:.4f}, at least {MIN_SINGULAR_VALUE})'
            if size < MIN_SINGULAR_VALUE
            else ''
        )

    def _flips(self, before: np.ndarray, q: np.ndarray) -> str:
        far = np.abs(q - before)
        n = int(np.argmax(far))
        return f'{self._chain.names[n]} would jump: a singularity' if far[n] > FLIP else ''

    # ---- one place

    def _solve(self, q: np.ndarray, tip: np.ndarray) -> np.ndarray | None:
        """Joints with the torch there, from those nearby; None where Newton steps do not lead there."""
        q, wanted = q.copy(), tip + self._origin
        q[self._order[AXES:]] = self._hold[self._order[AXES:]]
        for _ in range(STEPS):
            pose, jacobian = self._chain.pose_and_jacobian(q)
            off = np.concatenate([wanted - pose[:3, 3], _rotvec(self._turn @ pose[:3, :3].T)])
            missing = float(np.abs(off).max())
            if missing < POSE_TOLERANCE:
                return q
            j = jacobian[:, self._moving]
            step = j.T @ np.linalg.solve(j @ j.T + 1e-10 * np.eye(6), off)
            q[self._moving] += step * min(1.0, STEP_MAX / max(float(np.abs(step).max()), 1e-12))
            if missing < NEXT:
                return q
        return None


def _through(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(N, 3) m: from the middle of the box to a corner, then to and fro through all of it, GRID apart at most."""
    x, y, z = (
        np.linspace(a, b, int(np.ceil((b - a) / GRID)) + 1) for a, b in zip(low, high, strict=True)
    )
    first = np.linspace((low + high) / 2, low, max(len(x), len(y), len(z)))[1:-1]
    rows = [
        np.column_stack([x[:: 1 - 2 * ((i + k * len(y)) % 2)], np.full(len(x), y[j]), np.full(len(x), z[k])])
        for k in range(len(z))
        for i, j in enumerate(range(len(y)) if k % 2 == 0 else range(len(y) - 1, -1, -1))
    ]  # fmt: skip
    return np.concatenate([first, *rows])


def _rotvec(turn: np.ndarray) -> np.ndarray:
    """(3,) rad of a rotation (3, 3); the library's takes ten times as long for one."""
    across = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = float(np.linalg.norm(across)) / 2, (float(np.trace(turn)) - 1) / 2
    if cosine < -0.9:
        return np.asarray(Rotation.from_matrix(turn).as_rotvec())
    return across / 2 * (np.arctan2(sine, cosine) / sine if sine > 1e-8 else 1.0)


def _spun(angle: float) -> np.ndarray:
    """(3, 3): the torch's axes on the part (z out of it), its x at an angle to the part's."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _where(tip: np.ndarray) -> str:
    return '(' + ', '.join(f'{v * 1e3:.0f}' for v in tip) + ')'
