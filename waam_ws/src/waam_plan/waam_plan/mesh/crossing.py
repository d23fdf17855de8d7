"""Faces of a mesh that pass through each other, with the place."""

from __future__ import annotations

import numpy as np
import shapely

MAX_FACES = 200_000
CHUNK = 500_000  # pairs looked at together
INSIDE = 1e-6  # share of an edge or face: closer to its border counts as touching, not crossing


def crossings(triangles: np.ndarray, faces: np.ndarray) -> tuple[int, np.ndarray | None]:
    """Number of pairs of faces that cross and a point (3,) of one of them.

    triangles: (n, 3, 3) m; faces: (n, 3) vertex numbers. Faces that share a vertex are neighbours and left out.
    Raises ValueError for meshes of more than MAX_FACES faces.
    """
    if len(faces) > MAX_FACES:
        raise ValueError(f'{len(faces)} faces are too many to look for crossings')
    count, first = 0, None
    pairs = _near(triangles)
    for k in range(0, len(pairs), CHUNK):
        a, b = pairs[k : k + CHUNK].T
        shared = (faces[a][:, :, None] == faces[b][:, None, :]).any(axis=(1, 2))
        a, b = a[~shared], b[~shared]
        hit, at = _pierced(triangles[a], triangles[b])
        back, at_back = _pierced(triangles[b], triangles[a])
        both = hit | back
        count += int(both.sum())
        if first is None and both.any():
            i = int(np.flatnonzero(both)[0])
            first = at[i] if hit[i] else at_back[i]
    return count, first


def _near(triangles: np.ndarray) -> np.ndarray:
    """(k, 2) pairs of faces whose boxes overlap."""
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    a, b = shapely.STRtree(boxes).query(boxes)
    keep = (a < b) & (low[a, 2] <= high[b, 2]) & (low[b, 2] <= high[a, 2])
    return np.column_stack([a[keep], b[keep]])


def _pierced(edges_of: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether an edge of the first passes through the second (n,), and where (n, 3) (Moeller, Trumbore 1997)."""
    hit = np.zeros(len(faces), bool)
    place = np.zeros((len(faces), 3))
    u, v = faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    for i in range(3):
        start = edges_of[:, i]
        way = edges_of[:, (i + 1) % 3] - start
        h = np.cross(way, v)
        det = (u * h).sum(axis=1)
        size = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1) * np.linalg.norm(way, axis=1)
        flat = np.abs(det) <= 1e-9 * size
        inv = 1 / np.where(flat, 1.0, det)
        s = start - faces[:, 0]
        q = np.cross(s, u)
        b, c, t = ((x * y).sum(axis=1) * inv for x, y in ((s, h), (way, q), (v, q)))
        through = ~flat & (t > INSIDE) & (t < 1 - INSIDE)
        through &= (b > INSIDE) & (c > INSIDE) & (b + c < 1 - INSIDE)
        place[through] = (start + t[:, None] * way)[through]
        hit |= through
    return hit, place
