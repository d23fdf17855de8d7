"""Cracks of a mesh: corners that belong together, but were written a micrometre apart."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy import sparse
from scipy.spatial import cKDTree

TOLERANCE = 20e-6  # m; far below a bead, far above the rounding of a file
NEAREST = 8


def edge_use(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Unique edges (n, 2), in the order of their vertex numbers, and how many faces use each."""
    count = len(mesh.vertices)
    edges = np.asarray(mesh.edges_sorted, np.int64)
    key, use = np.unique(edges[:, 0] * count + edges[:, 1], return_counts=True)
    return np.column_stack([key // count, key % count]), use


def welded(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """The mesh (m) with corners of open edges within TOLERANCE made one, and what was done ('' = nothing)."""
    edges, use = edge_use(mesh)
    rim = np.unique(edges[use == 1])
    if len(rim) < 2:
        return mesh, ''
    places = mesh.vertices[rim]
    k = min(NEAREST, len(rim))
    far, near = cKDTree(places).query(places, k, distance_upper_bound=TOLERANCE)
    i, j = np.nonzero(np.isfinite(far) & (near != np.arange(len(rim))[:, None]))
    if not len(i):
        return mesh, ''
    links = sparse.coo_matrix((np.ones(len(i)), (i, near[i, j])), shape=(len(rim), len(rim)))
    count, label = sparse.csgraph.connected_components(links, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label, places)
    np.maximum.at(high, label, places)
    size = np.linalg.norm(high - low, axis=1)
    _, first = np.unique(label, return_index=True)
    join = (size[label] <= 2 * TOLERANCE) & (size[label] > 0)  # a longer chain is no crack
    number = np.arange(len(mesh.vertices))
    number[rim] = np.where(join, rim[first][label], rim)
    gone = int((number != np.arange(len(number))).sum())
    if not gone:
        return mesh, ''
    return trimesh.Trimesh(mesh.vertices, number[mesh.faces], process=False), (
        f'{gone} corners up to {size[size <= 2 * TOLERANCE].max() * 1e6:.2g} um apart were welded '
        f'(tolerance {TOLERANCE * 1e6:g} um)'
    )
