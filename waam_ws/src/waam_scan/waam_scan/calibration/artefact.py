"""Bodies of known shape for the calibration: where a point lies against their surface.

The artefact frame has its origin in `position` (work frame), z up, and is turned by `yaw` about z. A body is a union of
convex solids standing on the plane z = 0, the table: a truncated pyramid, or balls. Lengths in m, angles in rad.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

MARGIN = 0.5e-3  # m, points this close to an edge between two surfaces belong to neither
FOOT = 1.0e-3  # m, above the table: nearer points may be table, weld spatter or dirt in the corner
BELOW_CREST = 0.2  # of the radius: points on a ball lower than this above its equator are grazing


class ArtefactError(ValueError):
    """An artefact file that makes no sense; the text names the field."""


@dataclass(frozen=True)
class Contact:
    """Points against the surface. distance: (n,) m, + outside; normal: (n, 3) outward, artefact frame; face: (n,) int,
    number of the surface; good: (n,) bool, belongs to one surface beyond doubt."""

    distance: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    good: np.ndarray


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
        normals, offsets = [(0.0, 0.0, 1.0)], [height]
        for axis in (0, 1):
            s, c = np.sin(slopes[axis]), np.cos(slopes[axis])
            for sign in (1.0, -1.0):
                n = np.zeros(3)
                n[axis], n[2] = sign * s, c
                normals.append(tuple(n))
                offsets.append(s * 0.5 * top[axis] + c * height)
        return cls(np.array(normals), np.array(offsets), height)

    def contact(self, p: np.ndarray) -> Contact:
        d = p @ self.normals.T - self.offsets
        order = np.argsort(d, axis=1)
        face, second = order[:, -1], order[:, -2]
        rows = np.arange(len(p))
        nearest = d[rows, face]
        clear = nearest - d[rows, second] > MARGIN
        return Contact(nearest, self.normals[face], face, clear & (p[:, 2] > FOOT))


@dataclass(frozen=True)
class Balls:
    """Spheres: centers (k, 3) in the artefact frame, radii (k,)."""

    centers: np.ndarray
    radii: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f'ball {i + 1}' for i in range(len(self.radii)))

    @property
    def height(self) -> float:
        return float((self.centers[:, 2] + self.radii).max())

    def contact(self, p: np.ndarray) -> Contact:
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
    """A body on the table. position: (3,) m of its origin in the work frame, position_sigma: standard uncertainty of
    each coordinate (0 = exact, inf = unknown); yaw and yaw_sigma; tilt_sigma: rad, how well z is up; use_table: the
    table itself is part of the body (flat, at z = 0)."""

    body: Block | Balls
    position: np.ndarray
    position_sigma: np.ndarray = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    yaw_sigma: float = 0.0
    tilt_sigma: float = 0.0
    use_table: bool = False
    name: str = 'artefact'

    @property
    def faces(self) -> tuple[str, ...]:
        return (*self.body.names, 'table')

    @property
    def rotation(self) -> np.ndarray:
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


def load_artefact(path: Path) -> Artefact:
    """Reads the YAML file that `waam scan calibrate --help` describes. ArtefactError names file and field."""
    try:
        data = yaml.safe_load(Path(path).read_text())
    except FileNotFoundError:
        raise ArtefactError(f'{path}: no such file') from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as e:
        raise ArtefactError(f'{path}: cannot be read: {e}') from None
    try:
        return artefact_of(data, Path(path).stem)
    except ArtefactError as e:
        raise ArtefactError(f'{path}: {e}') from None


COMMON = {
    'kind', 'name', 'position_mm', 'position_sigma_mm', 'yaw_deg', 'yaw_sigma_deg', 'tilt_sigma_deg', 'table',
}  # fmt: skip
KINDS = {'block': {'top_mm', 'height_mm', 'slope_deg'}, 'spheres': {'spheres'}}


def artefact_of(data: object, name: str = 'artefact') -> Artefact:
    """From the contents of the file."""
    if not isinstance(data, dict) or data.get('kind') not in KINDS:
        raise ArtefactError(f'kind must be one of {", ".join(KINDS)}')
    unknown = set(map(str, data)) - COMMON - KINDS[data['kind']]
    if unknown:
        raise ArtefactError(f'unknown field {", ".join(sorted(unknown))}')
    table = data.get('table', 'ignored')
    if table not in ('ignored', 'used'):
        raise ArtefactError(f"table must be 'ignored' or 'used', not {table!r}")
    return Artefact(
        body=_block(data) if data['kind'] == 'block' else _balls(data),
        position=_numbers(data, 'position_mm', 3) * 1e-3,
        position_sigma=_numbers(data, 'position_sigma_mm', 3, 0.01, low=0.0) * 1e-3,
        yaw=float(np.radians(_numbers(data, 'yaw_deg', 1, 0.0)[0])),
        yaw_sigma=float(np.radians(_numbers(data, 'yaw_sigma_deg', 1, 0.01, low=0.0)[0])),
        tilt_sigma=float(np.radians(_numbers(data, 'tilt_sigma_deg', 1, 0.01, low=0.0)[0])),
        use_table=table == 'used',
        name=str(data.get('name', name)),
    )


def _block(data: dict) -> Block:
    top = _numbers(data, 'top_mm', 2, low=1.0, high=500.0) * 1e-3
    height = _numbers(data, 'height_mm', 1, low=2.0, high=200.0)[0] * 1e-3
    slopes = np.radians(_numbers(data, 'slope_deg', 2, 45.0, low=5.0, high=85.0))
    return Block.of(tuple(top), float(height), tuple(slopes))


def _balls(data: dict) -> Balls:
    balls = data.get('spheres')
    if not isinstance(balls, list) or not balls or not all(isinstance(b, dict) for b in balls):
        raise ArtefactError('spheres must be a list of {center_mm: [x, y, z], radius_mm: r}')
    centers = np.array([_numbers(b, 'center_mm', 3) for b in balls]) * 1e-3
    radii = np.array([_numbers(b, 'radius_mm', 1, low=1.0, high=100.0)[0] for b in balls]) * 1e-3
    return Balls(centers, radii)


def _numbers(
    data: dict,
    name: str,
    count: int,
    default: float | None = None,
    low: float = -np.inf,
    high: float = np.inf,
) -> np.ndarray:
    """(count,) numbers of a field; one number stands for all of them."""
    value = data.get(name, default)
    if value is None:
        raise ArtefactError(f'{name} is missing')
    try:
        numbers = np.array(value, float).ravel()
    except (TypeError, ValueError):
        raise ArtefactError(f'{name} must be {count} numbers, not {value!r}') from None
    if numbers.size == 1 and name != 'position_mm':
        numbers = np.repeat(numbers, count)
    if numbers.size != count or np.isnan(numbers).any():
        raise ArtefactError(f'{name} must be {count} numbers, not {value!r}')
    if 'sigma' not in name and not np.isfinite(numbers).all():
        raise ArtefactError(f'{name} must be finite, not {value!r}')
    if (numbers < low).any() or (numbers > high).any():
        raise ArtefactError(f'{name} is {value!r}, must be within {low:g} .. {high:g}')
    return numbers
