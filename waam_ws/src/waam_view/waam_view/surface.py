"""Height maps as pictures and meshes: arrays in, arrays out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec

_DIVERGING = np.array(  # blue - white - red, 11 equal steps
    [
        (5, 48, 97), (33, 102, 172), (67, 147, 195), (146, 197, 222), (209, 229, 240), (247, 247, 247),
        (253, 219, 199), (244, 165, 130), (214, 96, 77), (178, 24, 43), (103, 0, 31),
    ],
    float,
)  # fmt: skip
_SEQUENTIAL = np.array(
    [(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], float
)
UNKNOWN = (70, 74, 80)
MAX_VERTICES = 150_000


def colours(values: np.ndarray, low: float, high: float, diverging: bool = True) -> np.ndarray:
    """uint8 (..., 3) of values between low and high; UNKNOWN where NaN."""
    table = _DIVERGING if diverging else _SEQUENTIAL
    known = np.isfinite(values)
    share = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-12), 0.0, 1.0)
    at = share * (len(table) - 1)
    first = np.minimum(at.astype(int), len(table) - 2)
    rest = (at - first)[..., None]
    rgb = table[first] * (1 - rest) + table[first + 1] * rest
    return np.where(known[..., None], rgb, UNKNOWN).astype(np.uint8)


def picture(values: np.ndarray, low: float, high: float, diverging: bool = True) -> np.ndarray:
    """uint8 (rows, cols, 3) with y up, as people expect a map."""
    return colours(values[::-1], low, high, diverging)


@dataclass(frozen=True)
class Mesh:
    """A surface as triangles."""

    vertices: np.ndarray  # (n, 3) float32 m
    normals: np.ndarray  # (n, 3) float32
    triangles: np.ndarray  # (m, 3) uint32
    colours: np.ndarray  # (n, 3) uint8


def mesh(spec: GridSpec, z: np.ndarray, rgb: np.ndarray) -> Mesh:
    """Surface through the cell centres. Triangles that touch an unknown height are left out; large
    maps are thinned.

    rgb: (rows, cols, 3) uint8, colour of each cell.
    """
    step = max(1, int(np.ceil(np.sqrt(z.size / MAX_VERTICES))))
    z, rgb, x, y = z[::step, ::step], rgb[::step, ::step], spec.x[::step], spec.y[::step]
    known = np.isfinite(z)
    number = np.full(z.shape, -1, np.int64)
    number[known] = np.arange(known.sum())
    grid_x, grid_y = np.meshgrid(x, y)
    vertices = np.stack([grid_x[known], grid_y[known], z[known]], 1).astype(np.float32)
    normals = _normals(z, spec.resolution * step)[known].astype(np.float32)
    return Mesh(vertices, normals, _triangles(number), rgb[known])


def _triangles(number: np.ndarray) -> np.ndarray:
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    whole = np.concatenate(
        [np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)]
    )
    return whole[(whole >= 0).all(1)].astype(np.uint32)


def _normals(z: np.ndarray, spacing: float) -> np.ndarray:
    if min(z.shape) < 2:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), (*z.shape, 3))
    dy, dx = np.gradient(np.where(np.isfinite(z), z, np.nan), spacing)
    n = np.stack([-np.nan_to_num(dx), -np.nan_to_num(dy), np.ones_like(z)], -1)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)


@dataclass(frozen=True)
class LayerPath:
    """n deposition segments of one layer."""

    layer: int
    start: np.ndarray  # (n, 3) m
    end: np.ndarray  # (n, 3) m
    height: np.ndarray  # (n,) m
    width: np.ndarray  # (n,) m
    speed: np.ndarray  # (n,) m/s

    def planned_speed(self, point: tuple[float, float, float]) -> float:
        """Speed of the segment nearest to a point (m), m/s; NaN without segments."""
        if not len(self.start):
            return float('nan')
        distance = _distance(np.array([[point[0], point[1]]]), self.start[:, :2], self.end[:, :2])
        return float(self.speed[int(distance[0].argmin())])


def _distance(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(points, segments) distances in the plane."""
    along = end - start
    square = np.maximum((along**2).sum(1), 1e-18)
    share = np.clip(((points[:, None] - start) * along).sum(-1) / square, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - (start + share[..., None] * along), axis=-1)
