"""Profile points to the work frame: the scanner's mounting on the torch, and the table motion that is in the pose."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np


def rotation_rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """(3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll), rad: the fixed-axis convention of URDF and REP-103."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@dataclass(frozen=True)
class Mounting:
    """The scanner frame in the frame of torch_tcp (parallel to work while the torch points straight down).

    A profile point is (x_s, 0, z_s): P_work = P_tcp + offset + rotation @ (x_s, 0, z_s).
    """

    # (3,) m, scanner origin
    offset: np.ndarray = field(default_factory=lambda: np.array([0.060, 0.0, 0.120]))
    # (3, 3) takes scanner coordinates to work directions
    rotation: np.ndarray = field(default_factory=lambda: rotation_rpy(0.0, 0.0, math.pi / 2))
    delay: float = 0.0  # s, added to profile stamps to bring them onto the clock of the poses

    def __post_init__(self) -> None:
        r = np.asarray(self.rotation, float)
        if np.shape(self.offset) != (3,) or not np.isfinite(self.offset).all():
            raise ValueError(
                f'mounting offset must be three finite lengths in m, not {self.offset}'
            )
        if (
            r.shape != (3, 3)
            or not np.allclose(r @ r.T, np.eye(3), atol=1e-6)
            or np.linalg.det(r) < 0
        ):
            raise ValueError(f'mounting rotation must be a 3 x 3 rotation matrix, not {r.tolist()}')

    @classmethod
    def from_rpy(cls, xyz: tuple, rpy: tuple, delay: float = 0.0) -> Mounting:
        """From translation (m) and roll, pitch, yaw (rad). ValueError names what is wrong."""
        if len(xyz) != 3 or len(rpy) != 3:
            raise ValueError(f'a mounting needs 3 + 3 numbers, not {len(xyz)} + {len(rpy)}')
        return cls(np.array(xyz, float), rotation_rpy(*rpy), delay)

    @property
    def along_rows(self) -> bool:
        """Whether a profile runs along y rather than along x: from row to row of a grid in the work frame."""
        return bool(abs(self.rotation[1, 0]) > abs(self.rotation[0, 0]))

    def origins(self, tcp: np.ndarray) -> np.ndarray:
        """Scanner origins (n, 3) in the work frame from wire tip positions (n, 3), m."""
        return np.asarray(tcp, float) + self.offset

    def points(self, tcp: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(n, m, 3) points in the work frame from tcp (n, 3) and profiles x, z (n, m), m. NaN stays NaN."""
        axes = self.rotation[:, 0], self.rotation[:, 2]
        profile = x[..., None] * axes[0] + z[..., None] * axes[1]
        return self.origins(tcp)[:, None, :] + profile
