"""Rotations and poses. A pose is a 4 x 4 homogeneous matrix, or (..., 4, 4) of them: metres, radians."""

from __future__ import annotations

import numpy as np

GIMBAL = 1e-9  # length of the horizontal part of the x axis below which P is taken as +-90 degrees


def rotation(axis: int, angle: np.ndarray | float) -> np.ndarray:
    """(..., 4, 4): turn about the coordinate axis 0, 1 or 2 by angle (...,) in rad."""
    angle = np.asarray(angle, float)
    out = np.zeros((*angle.shape, 4, 4))
    out[..., axis, axis] = out[..., 3, 3] = 1.0
    a, b = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out[..., a, a] = out[..., b, b] = c
    out[..., a, b], out[..., b, a] = -s, s
    return out


def translation(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(4, 4): shift in m."""
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def inverse(pose: np.ndarray) -> np.ndarray:
    """(..., 4, 4): of rigid motions, by the transpose."""
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    out = np.zeros_like(pose)
    out[..., :3, :3] = turned
    out[..., :3, 3] = -(turned @ pose[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def pose_from_wpr(position: np.ndarray, wpr: np.ndarray) -> np.ndarray:
    """(..., 4, 4) from positions (..., 3) in m and W, P, R (..., 3) in rad: R = Rz(R) Ry(P) Rx(W).

    S3 eqs 2.1 and 2.4; some elements of the printed matrices are wrong (docs/equations.md).
    """
    position, wpr = np.asarray(position, float), np.asarray(wpr, float)
    out = rotation(2, wpr[..., 2]) @ rotation(1, wpr[..., 1]) @ rotation(0, wpr[..., 0])
    out[..., :3, 3] = position
    return out


def wpr(pose: np.ndarray) -> np.ndarray:
    """(..., 3): W, P, R in rad of poses (..., 4, 4). S3 eq 2.2; R = 0 where P is +-90 degrees."""
    m = pose[..., :3, :3]
    flat = np.hypot(m[..., 0, 0], m[..., 1, 0])
    p = np.arctan2(-m[..., 2, 0], flat)
    locked = flat < GIMBAL
    w = np.where(
        locked,
        np.where(p > 0, 1.0, -1.0) * np.arctan2(m[..., 0, 1], m[..., 1, 1]),
        np.arctan2(m[..., 2, 1], m[..., 2, 2]),
    )
    r = np.where(locked, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([w, p, r], axis=-1)


def wrapped(angle: np.ndarray) -> np.ndarray:
    """The same angles in -pi ... pi."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def check_poses(poses: np.ndarray, what: str, tolerance: float = 1e-6) -> np.ndarray:
    """(N, 4, 4) as floats. ValueError that names the first one that is no rigid motion, and why."""
    poses = np.asarray(poses, float)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f'{what}: poses have the shape {poses.shape}, wanted (N, 4, 4)')
    finite = np.isfinite(poses).all(axis=(1, 2))
    if not finite.all():
        raise ValueError(f'{what} {int(np.argmin(finite))}: a number that is not finite')
    r = poses[:, :3, :3]
    off = np.abs(np.swapaxes(r, 1, 2) @ r - np.eye(3)).max(axis=(1, 2), initial=0.0)
    bad = (off > tolerance) | (np.linalg.det(r) < 0)
    bad |= np.abs(poses[:, 3] - [0, 0, 0, 1]).max(axis=1, initial=0.0) > tolerance
    if bad.any():
        n = int(np.argmax(bad))
        raise ValueError(
            f'{what} {n}: no rotation (axes deviate by {off[n]:.2g} from unit length and right angles, '
            f'or are left-handed)'
        )
    return poses
