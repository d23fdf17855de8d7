"""Which motions the shape of two surfaces shows, and how well.

Normals of a scan are noisy, and squares of noise look like information: a flat plate seems to show its sideways
position. The equations therefore multiply the normals of one surface with those of the other (instrumental variables,
Wright 1928). Their noise is independent and averages out; what remains is the shape.
"""

from __future__ import annotations

import numpy as np

TOLERANCE = np.array([30e-6] * 3 + [np.radians(0.01)] * 3)  # demanded accuracy: unit of the motions
RELIABLE = 0.3  # correlation of the two surfaces' normals from which a direction is more than noise
PATCH = 4e-3  # m, edge of the patches whose errors may be alike


def shown_motions(
    rows: np.ndarray, other: np.ndarray, w: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """From the equations of both clouds, rows and other (n, 6; in tolerances), their weights w (n,) and the noise (m):
    orthonormal bases (6, k) of the motions that the shape shows and (6, 6 - k) of those that it does not.

    A motion is shown when independent points would fix it to its tolerance, and when the normals of the two
    clouds agree on it (RELIABLE). What neighbours share in errors is judged at the end, by the covariance.
    """
    cross = (other * w[:, None]).T @ rows
    values, vectors = np.linalg.eigh(0.5 * (cross + cross.T))
    a = np.einsum('ik,ij,jk->k', vectors, (rows * w[:, None]).T @ rows, vectors)
    b = np.einsum('ik,ij,jk->k', vectors, (other * w[:, None]).T @ other, vectors)
    agree = values / np.sqrt(np.maximum(a * b, 1e-300))
    shown = (values > noise**2) & (agree > RELIABLE)
    return vectors[:, shown], vectors[:, ~shown]


def covariance(
    points: np.ndarray, scores: np.ndarray, cross: np.ndarray, shown: np.ndarray
) -> np.ndarray:
    """(6, 6) in tolerances: sandwich over patches of the surface, zero where nothing is shown.

    points: (n, 3) m; scores: (n, 6) rows of the equations times their errors.
    """
    patch = np.floor(points / PATCH).astype(np.int64)
    _, group = np.unique(patch, axis=0, return_inverse=True)
    sums = np.zeros((int(group.max()) + 1, 6))
    np.add.at(sums, group.ravel(), scores)
    inverse = shown @ np.linalg.inv(shown.T @ cross @ shown) @ shown.T
    return inverse @ (sums.T @ sums) @ inverse.T


def too_wide(covariance: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """(k, m) directions within `shown` whose standard uncertainty exceeds three tolerances: found, but not known."""
    values, vectors = np.linalg.eigh(shown.T @ covariance @ shown)
    return vectors[:, values > 9.0]
