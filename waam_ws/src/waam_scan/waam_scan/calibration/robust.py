"""Robust weights, small rotations and covariances that hold when neighbours share their errors."""

from __future__ import annotations

import numpy as np

GROUP = 5  # neighbouring profiles whose errors may be alike


def turned(vector: np.ndarray) -> np.ndarray:
    """(3, 3) rotation about `vector` by its length in rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)


def turn_vector(rotation: np.ndarray) -> np.ndarray:
    """(3,) rotation vector of a rotation by less than half a turn, rad."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


def tukey_weights(residuals: np.ndarray, limit: float) -> np.ndarray:
    """Tukey's biweight of residuals (n,): 1 at zero, 0 from `limit` on, which has their unit."""
    u = np.clip(residuals / limit, -1.0, 1.0)
    return (1.0 - u * u) ** 2


def robust_scatter(residuals: np.ndarray) -> float:
    """1.4826 times the median absolute residual: the standard deviation of normal errors about zero; NaN for none."""
    return 1.4826 * float(np.median(np.abs(residuals))) if len(residuals) else float('nan')


def group_scores(profile: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Sums of the scores (n, k) over groups of GROUP neighbouring profiles; profile: (n,) their numbers, rising."""
    group = profile // GROUP
    starts = np.flatnonzero(np.diff(group, prepend=-1))
    return np.add.reduceat(scores, starts, axis=0)


def sandwich(hessian: np.ndarray, scores: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Cluster-robust covariance (k, k), nowhere narrower than that of independent points.

    hessian, prior: (k, k); scores: (groups, k) of `group_scores`.
    """
    inverse = np.linalg.inv(hessian)
    wide = inverse @ (scores.T @ scores + prior) @ inverse
    grow = np.sqrt(np.maximum(np.diag(inverse) / np.diag(wide), 1.0))
    return wide * np.outer(grow, grow)


def wide(covariance: np.ndarray, limit: float) -> list[np.ndarray]:
    """(7, k) orthonormal directions in which the standard uncertainty (in tolerances) exceeds `limit`, widest first.

    Directions whose uncertainties differ more than tenfold come in different arrays: mixing them would hide the
    unknown ones behind those that are known a little.
    """
    values, vectors = np.linalg.eigh(covariance)
    wide = np.flatnonzero(values > limit**2)[::-1]
    if not len(wide):
        return []
    cuts = np.flatnonzero(values[wide[:-1]] > 100 * values[wide[1:]]) + 1
    return [vectors[:, group] for group in np.split(wide, cuts)]


def beside(groups: list[np.ndarray], known: np.ndarray) -> np.ndarray:
    """(7, k) orthonormal part of the directions that is not within `known` (7, m)."""
    if not groups:
        return np.empty((7, 0))
    rest = np.hstack(groups)
    u, size, _ = np.linalg.svd(rest - known @ (known.T @ rest), full_matrices=False)
    return u[:, size > 0.5]
