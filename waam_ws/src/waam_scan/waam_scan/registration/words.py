"""Names for motions that two surfaces do not show: sliding on a plane, turning about a shaft."""

from __future__ import annotations

import numpy as np

AXES = 'xyz'
TURN = 0.3  # share of rotation below which a motion is a slide
STRAIGHT = 0.99  # cosine from which a direction counts as an axis


def free_motions(free: np.ndarray, unit: np.ndarray, centre: np.ndarray) -> list[str]:
    """Free motions (6, k; orthonormal; of `centre`, and rotation about x, y, z) in words.

    unit: (6,) m and rad that one stands for; centre: (3,) m.
    """
    if free.shape[1] == 0:
        return []
    _, s, vt = np.linalg.svd(free[3:])
    turns = int((s > TURN).sum())
    basis = free @ vt.T * unit[:, None]
    return _slides(basis[:3, turns:]) + [_turn(r, centre) for r in basis[:, :turns].T]


def direction_name(v: np.ndarray) -> str:
    """The axis that v (3,) lies along, or the direction as three numbers."""
    v = v / max(np.linalg.norm(v), 1e-30)
    i = int(np.argmax(np.abs(v)))
    if abs(v[i]) > STRAIGHT:
        return AXES[i]
    return '({:.2f}, {:.2f}, {:.2f})'.format(*(v * np.sign(v[i])))


def _slides(vectors: np.ndarray) -> list[str]:
    if not vectors.size:
        return []
    q, size, _ = np.linalg.svd(vectors, full_matrices=True)
    count = len(size)
    if count == 1:
        return [f'sliding along {direction_name(q[:, 0])}']
    if count == 2:
        return [f'sliding on the plane with normal {direction_name(q[:, 2])}']
    return ['position in every direction']


def _turn(motion: np.ndarray, centre: np.ndarray) -> str:
    """A turn with its axis (the screw's own axis; its pitch is not named)."""
    u, w = motion[:3], motion[3:]
    at = centre + np.cross(w, u) / (w @ w)
    name = direction_name(w)
    at = at - w * (w @ at) / (w @ w)
    return (
        f'turning about {name} through ({at[0] * 1e3:.1f}, {at[1] * 1e3:.1f}, {at[2] * 1e3:.1f}) mm'
    )
