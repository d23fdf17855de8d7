"""Bodies of known shape for the calibration: where a point lies against their surface.

The artefact frame has its origin in `position` (work frame), z up, and is turned by `yaw` about z. A body is a union of
convex solids standing on the plane z = 0, the table: a truncated pyramid, or balls. Lengths in m, angles in rad.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

MARGIN = 0.5e-3  # m, points this close to an edge between two surfaces belong to neither
FOOT = 1.0e-3  # m, above the table: nearer points may be table, weld spatter or dirt in the corner
BELOW_CREST = 0.2  # of the radius: points on a ball lower than this above its equator are grazing


class ArtefactError(ValueError):
    """An artefact that cannot exist; the text names the field."""


@dataclass(frozen=True)
class Contact:
    """n points against the surface of the artefact."""

    distance: np.ndarray  # (n,) m, + outside
    normal: np.ndarray  # (n, 3) outward, artefact frame
    face: np.ndarray  # (n,) int, number of the surface
    good: np.ndarray  # (n,) bool, belongs to one surface beyond doubt


@dataclass(frozen=True)
class Block:
    """Truncated pyramid: planes normals @ p <= offsets (5: top, +x, -x, +y, -y), foot on z = 0."""

    normals: np.ndarray
    offsets: np.ndarray
    height: float
    names = ('top', 'slope +x', 'slope -x', 'slope +y', 'slope -y')

    @classmethod
    def of(cls, top: tuple[float, float], height: float, slopes: tuple[float, float]) -> Block:
        """top: size of the top along x and y; slopes: of the sides in x and in y against the table, rad."""
        normals, offsets = [np.array([0.0, 0.0, 1.0])], [height]
        for axis in (0, 1):
            s, c = np.sin(slopes[axis]), np.cos(slopes[axis])
            for sign in (1.0, -1.0):
                n = np.zeros(3)
                n[axis], n[2] = sign * s, c
                normals.append(n)
                offsets.append(s * 0.5 * top[axis] + c * height)
        return cls(np.array(normals), np.array(offsets), height)

    def contact(self, p: np.ndarray) -> Contact:
        """Points (n, 3) m in the artefact frame against the nearest of the five planes; not good at edges and near the
        foot."""
        d = p @ self.normals.T - self.offsets
        order = np.argsort(d, axis=1)
        face, second = order[:, -1], order[:, -2]
        rows = np.arange(len(p))
        nearest = d[rows, face]
        clear = nearest - d[rows, second] > MARGIN
        return Contact(nearest, self.normals[face], face, clear & (p[:, 2] > FOOT))


@dataclass(frozen=True)
class Balls:
    """Spheres."""

    centers: np.ndarray  # (k, 3) m, artefact frame
    radii: np.ndarray  # (k,) m

    @property
    def names(self) -> tuple[str, ...]:
        """'ball 1' and so on, in the order of `radii`."""
        return tuple(f'ball {i + 1}' for i in range(len(self.radii)))

    @property
    def height(self) -> float:
        """Highest point above the table, m."""
        return float((self.centers[:, 2] + self.radii).max())

    def contact(self, p: np.ndarray) -> Contact:
        """Points (n, 3) m in the artefact frame against the nearest ball; not good far below its crest or near the
        table."""
        away = p[:, None, :] - self.centers
        length = np.linalg.norm(away, axis=2)
        face = np.argmin(length - self.radii, axis=1)
        rows = np.arange(len(p))
        away, length, radius = away[rows, face], length[rows, face], self.radii[face]
        normal = away / np.maximum(length, 1e-9)[:, None]
        good = (normal[:, 2] > BELOW_CREST) & (p[:, 2] > FOOT)
        return Contact(length - radius, normal, face, good)


@dataclass(frozen=True)
class Artefact:
    """A body on the table."""

    body: Block | Balls
    position: np.ndarray  # (3,) m, its origin in the work frame
    # (3,) m, standard uncertainty; 0 = exact, inf = unknown
    position_sigma: np.ndarray = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0  # rad
    yaw_sigma: float = 0.0  # rad
    tilt_sigma: float = 0.0  # rad, how well z is up
    use_table: bool = False  # the table is part of the body: flat, at z = 0
    name: str = 'artefact'

    @property
    def faces(self) -> tuple[str, ...]:
        """Names of the surfaces by the numbers in `Contact.face`; the last one is the table."""
        return (*self.body.names, 'table')

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) from the artefact frame to the work frame: by `yaw` about z."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @property
    def sigmas(self) -> np.ndarray:
        """(6,) prior standard uncertainty of position (m) and of rotation about x, y, z (rad)."""
        tilt = self.tilt_sigma
        return np.array([*self.position_sigma, tilt, tilt, self.yaw_sigma], float)

    def contact(self, p: np.ndarray) -> Contact:
        """Points p (n, 3) in the artefact frame against the nearer of body and table."""
        c = self.body.contact(p)
        table = p[:, 2] < c.distance
        near_both = np.abs(p[:, 2] - c.distance) < MARGIN
        normal = np.where(table[:, None], [0.0, 0.0, 1.0], c.normal)
        face = np.where(table, len(self.body.names), c.face)
        good = np.where(table, self.use_table, c.good) & ~near_both
        return Contact(np.where(table, p[:, 2], c.distance), normal, face, good)
