"""Arms of any kind from a URDF, with external axes in the chain, by Pinocchio: where the torch is on the part, and
joint paths of beads.

For arms with a spherical wrist the analytic inverse of `waam_robot.inverse` is better: it finds all branches. Here each
point is solved from the one before by Newton steps; the start is searched for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .bead import Bead
from .joint_nodes import JUMP
from .joint_path import PlanError
from .urdf_text import PART, TORCH, UrdfError, check_urdf

CLOSE = 1e-10  # m and rad
STEPS = 60
STARTS = 20
NEAR = 0.5  # rad: longest step of a search
LENGTH = 1e-6  # m: less is no length
EASY = 1e-4  # weight of going to the middle of the ranges


@dataclass(frozen=True)
class Follow:
    """joints: (N, n) in the order of `UrdfChain.names`; margin: least distance to a limit as share of the half range;
    off_flat: largest angle of the torch to upright, rad."""

    joints: np.ndarray
    margin: float
    off_flat: float


class UrdfChain:
    """The joints between the links `part` and `torch` (its z axis points to the part). UrdfError for a bad file, for
    links that are not there, and without Pinocchio."""

    def __init__(self, text: bytes | str, torch: str = TORCH, part: str = PART) -> None:
        good = check_urdf(text)
        self._pin = _pinocchio()
        try:
            self._model = self._pin.buildModelFromXML(good)
        except (RuntimeError, ValueError) as e:
            raise UrdfError(f'Pinocchio cannot read it: {e}') from None
        for name in (torch, part):
            if not self._model.existFrame(name):
                links = [f.name for f in self._model.frames if f.type == self._pin.FrameType.BODY]
                raise UrdfError(f"no link '{name}'; there are {', '.join(links)}")
        if self._model.nq != self._model.nv:
            raise UrdfError(
                'continuous joints are not supported: make them revolute with wide limits'
            )
        if not self._model.nq:
            raise UrdfError('no joint moves')
        self._data = self._model.createData()
        self._torch, self._part = (self._model.getFrameId(n) for n in (torch, part))
        self.names = tuple(self._model.names[1:])
        self.low, self.high = self._model.lowerPositionLimit, self._model.upperPositionLimit

    def forward(self, joints: np.ndarray) -> np.ndarray:
        """(N, 4, 4): torch on the part for joints (N, n); z out of the part."""
        return np.stack([self._on_part(np.asarray(q, float))[0] for q in joints])

    def lengthened(self, joints: np.ndarray, step: float) -> list[np.ndarray]:
        """(N, 4, 4) as `forward` for each length of the chain but where it stands, that one `step` (m) longer."""
        found = []
        for placement in list(self._model.jointPlacements)[2:]:
            for k in np.flatnonzero(np.abs(placement.translation) > LENGTH):
                kept = placement.translation.copy()
                placement.translation = kept + step * np.eye(3)[k]
                found.append(self.forward(joints))
                placement.translation = kept
        return found

    def placements(self, joints: np.ndarray, links: tuple[str, ...]) -> np.ndarray:
        """(N, L, 4, 4): links in the frame of the first one of the file, for joints (N, n)."""
        pin, model, data = self._pin, self._model, self._data
        numbers = [model.getFrameId(name, pin.FrameType.BODY) for name in links]
        out = np.empty((len(joints), len(links), 4, 4))
        for row, q in zip(out, np.asarray(joints, float), strict=True):
            pin.framesForwardKinematics(model, data, q)
            for n, number in enumerate(numbers):
                row[n] = data.oMf[number].homogeneous
        return out

    def follow(self, bead: Bead, start: np.ndarray | None = None, seed: int = 1) -> Follow:
        """A joint path of the bead, the torch as upright as two axes can hold it, its spin free.

        start: (n,) joints to begin near; else several are tried and the path that stays farthest from the limits is
        taken. PlanError with place and reason of the try that came farthest.
        """
        best, farthest = None, (-1, 'bead: no start was found')
        for q in self._starts(bead, start, seed):
            joints, at, why = self._along(bead, q)
            if why:
                farthest = max(farthest, (at, why))
                continue
            margin = self._margin(joints)
            if best is None or margin > best.margin:
                best = Follow(joints, margin, self._off_flat(joints))
        if best is None:
            raise PlanError(farthest[1])
        return best

    def pose_and_jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((4, 4) torch on the part, z out of it; (6, n) its speed and turn per joint, in the part's frame)."""
        pose, jacobian, _, _ = self._on_part(q)
        return pose, jacobian

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(6, n): m/s above rad/s of the torch on the part per joint speed."""
        return self._on_part(q)[1]

    # ---- one point -----------------------------------------------------------------------------

    def _on_part(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Torch on the part (z out of it), task Jacobian (6, n) in the part's frame, upright axis and its Jacobian."""
        pin, model, data = self._pin, self._model, self._data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        torch, part = data.oMf[self._torch], data.oMf[self._part]
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jt = pin.getFrameJacobian(model, data, self._torch, world)
        jp = pin.getFrameJacobian(model, data, self._part, world)
        lever = torch.translation - part.translation
        turn = part.rotation.T
        moved = jt[:3] - jp[:3] + _skew(lever) @ jp[3:]  # the part's turn moves it under the torch
        pose = np.eye(4)
        pose[:3, :3] = turn @ torch.rotation @ np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = turn @ lever
        up = -torch.rotation[:, 2]
        return pose, np.vstack([turn @ moved, turn @ (jt[3:] - jp[3:])]), up, jt[3:]

    def _step(self, q: np.ndarray, point: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, float]:
        """(joint step, what is still missing): point and torch axis first, then upright, then the middle of ranges."""
        pose, j, up, ju = self._on_part(q)
        z = pose[:3, 2]
        first, second = _across(z)
        error = np.concatenate([point - pose[:3, 3], _turns(z, axis, first, second)])
        task = np.vstack([j[:3], first @ j[3:], second @ j[3:]])
        inverse = _damped(task)
        step = inverse @ error
        free = np.eye(len(q)) - inverse @ task
        a, b = _across(up)
        flat = np.vstack([a @ ju, b @ ju])
        lean = _turns(up, np.array([0.0, 0.0, 1.0]), a, b) - flat @ step
        upright = flat @ free
        level = _damped(upright, 1e-6)
        second_step = free @ (level @ lean)
        rest = free - free @ level @ upright
        middle = (self.low + self.high) / 2
        ranges = np.minimum(self.high - self.low, 2 * np.pi)
        ease = rest @ (EASY * np.clip((middle - q) / ranges, -1, 1))
        return step + second_step + ease, float(np.abs(error).max())

    def _solve(self, q: np.ndarray, point: np.ndarray, axis: np.ndarray) -> np.ndarray | None:
        """Newton steps until point and axis are right; None where they do not come there."""
        for n in range(STEPS):
            step, missing = self._step(q, point, axis)
            if missing < CLOSE and n > 0:
                return q
            q = q + step * min(1.0, NEAR / max(float(np.abs(step).max()), 1e-12))
        return None

    # ---- a bead --------------------------------------------------------------------------------

    def _starts(self, bead: Bead, start: np.ndarray | None, seed: int) -> list[np.ndarray]:
        """Solutions of the first point inside the limits."""
        rng = np.random.default_rng(seed)
        low, high = np.maximum(self.low, -np.pi), np.minimum(self.high, np.pi)
        tries = [np.asarray(start, float)] if start is not None else []
        tries += [] if tries else list(rng.uniform(low, high, (STARTS, len(low))))
        found: list[np.ndarray] = []
        for q in tries:
            solved = self._solve(q, bead.points[0], bead.axes[0])
            if solved is None or (start is None and self.beyond(solved)):
                continue
            if all(np.abs(solved - other).max() > 0.1 for other in found):
                found.append(solved)
        if not found:
            raise PlanError(
                f'{_where(bead, 0)}: out of reach or beyond a limit from {len(tries)} starts'
            )
        return found

    def _along(self, bead: Bead, q: np.ndarray) -> tuple[np.ndarray, int, str]:
        """(joints, 0, '') or (joints so far, point, why it ends there)."""
        out: list[np.ndarray] = []
        for n in range(len(bead.points)):
            solved = self._solve(q, bead.points[n], bead.axes[n])
            if solved is None:
                return (
                    np.array(out),
                    n,
                    f'{_where(bead, n)}: out of reach, or through a singularity',
                )
            if said := self.beyond(solved):
                return np.array(out), n, f'{_where(bead, n)}: {said}'
            if n and np.abs(solved - q).max() > JUMP:
                name = self.names[int(np.abs(solved - q).argmax())]
                return np.array(out), n, f'{_where(bead, n)}: {name} would jump: a singularity'
            q = solved
            out.append(q)
        return np.array(out), 0, ''

    def beyond(self, q: np.ndarray) -> str:
        """Which joint (n,) is beyond its limit; '' = none."""
        out = (q < self.low) | (q > self.high)
        return '; '.join(
            f'{self.names[n]} would be {q[n]:.4f}, its range {self.low[n]:.4f} to {self.high[n]:.4f}'
            for n in np.flatnonzero(out)
        )

    def _margin(self, joints: np.ndarray) -> float:
        room = np.minimum(joints - self.low, self.high - joints) / (self.high - self.low) * 2
        return float(room.min())

    def _off_flat(self, joints: np.ndarray) -> float:
        up = np.array([self._on_part(q)[2] for q in joints])
        return float(np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2]).max())


def _pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError:
        raise UrdfError(
            'arms from a URDF need pin: pip install -r requirements-robot.txt'
        ) from None
    return pinocchio


def _across(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors at right angles to z and to each other."""
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    turn = _skew(z)
    first = turn @ helper
    first /= np.linalg.norm(first)
    return first, turn @ first


def _skew(v: np.ndarray) -> np.ndarray:
    """(3, 3): the cross product with v as a matrix; np.cross takes ten times as long for one vector."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _turns(z: np.ndarray, wanted: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(2,): turns about `first` and `second` that bring z to `wanted`, rad."""
    axis = _skew(z) @ wanted
    sine, cosine = float(np.linalg.norm(axis)), float(z @ wanted)
    if sine < 1e-15:
        return np.array([np.pi, 0.0]) if cosine < 0 else np.zeros(2)
    axis *= np.arctan2(sine, cosine) / sine
    return np.array([axis @ first, axis @ second])


def _damped(j: np.ndarray, damping: float = 1e-9) -> np.ndarray:
    """(n, m): damped pseudo-inverse of (m, n)."""
    return np.asarray(j.T @ np.linalg.inv(j @ j.T + damping * np.eye(len(j))))


def _where(bead: Bead, n: int) -> str:
    x, y, z = np.round(bead.points[n] * 1e3, 1) + 0.0
    return f'{bead.way[n] * 1e3:.1f} mm from the start of the bead, at ({x:.1f}, {y:.1f}, {z:.1f}) mm of the part'
