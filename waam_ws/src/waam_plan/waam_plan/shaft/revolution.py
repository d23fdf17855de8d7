"""Is a mesh a body of revolution? So that a shaft is not taken for a part that lies still."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

CORNERS = 12  # of a circle of the mesh, at least: fewer are a prism
WIDEST_GAP = np.radians(45.0)  # between neighbouring corners of a circle
SAME = 1e-5  # m, of corners of one circle
ON_AXIS = 1e-5  # m
ALIKE = 5e-3  # share by which the two moments across the axis may differ


@dataclass(frozen=True)
class Body:
    """A body of revolution. Lengths in m."""

    axis: np.ndarray  # (3,) unit vector
    diameter: float  # the largest
    length: float  # along the axis


def body_of(mesh: trimesh.Trimesh) -> Body | None:
    """The body of revolution that the mesh is; None where it is none: every corner lies on its axis or in a circle of
    at least CORNERS corners without a WIDEST_GAP."""
    points = np.asarray(mesh.vertices, float)
    if len(points) < 2 * CORNERS:
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    away = points - (low + high) / 2  # the middle of the box lies on the axis
    for axis in np.eye(3):
        across = np.flatnonzero(axis == 0)
        size = (high - low)[across]
        if abs(size[0] - size[1]) > ALIKE * size.max():
            continue
        if _all_in_circles(away @ axis, away[:, across]):
            return Body(
                axis, 2 * float(np.hypot(*away[:, across].T).max()), float(np.ptp(away @ axis))
            )
    return None


def _all_in_circles(along: np.ndarray, across: np.ndarray) -> bool:
    """along: (n,) m; across: (n, 2) m."""
    radius, angle = np.hypot(*across.T), np.arctan2(*across.T)
    order = np.lexsort((radius.round(5), along.round(5)))
    keys = np.column_stack([along, radius])[order]
    new = np.any(np.abs(np.diff(keys, axis=0)) > SAME, axis=1)
    for circle in np.split(order, np.flatnonzero(new) + 1):
        if radius[circle].max() <= ON_AXIS:
            continue
        at = np.sort(angle[circle])
        gaps = np.diff(np.concatenate([at, [at[0] + 2 * np.pi]]))
        if len(circle) < CORNERS or gaps.max() > WIDEST_GAP:
            return False
    return True
