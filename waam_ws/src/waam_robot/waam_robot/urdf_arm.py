"""Arms of any kind from a URDF, with external axes in the chain, by Pinocchio: where the torch is on the part."""

from __future__ import annotations

from typing import Any

import numpy as np

from .urdf_text import PART, TORCH, UrdfError, check_urdf


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
        return np.stack([self.pose_and_jacobian(np.asarray(q, float))[0] for q in joints])

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

    def pose_and_jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((4, 4) torch on the part, z out of it; (6, n) m/s above rad/s of it per joint speed, in its frame)."""
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
        return pose, np.vstack([turn @ moved, turn @ (jt[3:] - jp[3:])])

    def beyond(self, q: np.ndarray) -> str:
        """Which joint (n,) is beyond its limit; '' = none."""
        out = (q < self.low) | (q > self.high)
        return '; '.join(
            f'{self.names[n]} would be {q[n]:.4f}, its range {self.low[n]:.4f} to {self.high[n]:.4f}'
            for n in np.flatnonzero(out)
        )


def _pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError:
        raise UrdfError(
            'arms from a URDF need pin: pip install -r requirements-robot.txt'
        ) from None
    return pinocchio


def _skew(v: np.ndarray) -> np.ndarray:
    """(3, 3): the cross product with v as a matrix; np.cross takes ten times as long for one vector."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
