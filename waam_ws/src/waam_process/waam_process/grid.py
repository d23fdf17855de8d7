"""The height grid that every package shares: square cells, rows along +y, columns along +x, metres, NaN = unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .safe_files import read_npz


class GridError(ValueError):
    """A grid with invalid geometry or data; the text names the field."""


@dataclass(frozen=True)
class GridSpec:
    """Geometry of a grid in the work frame. Rows run along y, columns along x."""

    origin_x: float  # m, corner of cell (0, 0)
    origin_y: float  # m
    resolution: float  # m, edge of a cell
    rows: int
    cols: int

    def __post_init__(self) -> None:
        if not (np.isfinite(self.resolution) and self.resolution > 0):
            raise GridError(f'resolution must be a positive length in m, not {self.resolution}')
        if not (np.isfinite(self.origin_x) and np.isfinite(self.origin_y)):
            raise GridError(f'origin must be finite, not ({self.origin_x}, {self.origin_y})')
        if self.rows < 1 or self.cols < 1 or self.rows * self.cols > 2**26:
            raise GridError(f'a grid of {self.rows} x {self.cols} cells is not usable')

    @classmethod
    def covering(
        cls, x_min: float, y_min: float, x_max: float, y_max: float, resolution: float
    ) -> GridSpec:
        """The smallest grid with corner (x_min, y_min) that covers the rectangle (m)."""
        cols = max(1, int(np.ceil((x_max - x_min) / resolution - 1e-9)))
        rows = max(1, int(np.ceil((y_max - y_min) / resolution - 1e-9)))
        return cls(x_min, y_min, resolution, rows, cols)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols), as of a numpy array."""
        return self.rows, self.cols

    @property
    def x(self) -> np.ndarray:
        """Cell centres along x, (cols,), m."""
        return self.origin_x + (np.arange(self.cols) + 0.5) * self.resolution

    @property
    def y(self) -> np.ndarray:
        """Cell centres along y, (rows,), m."""
        return self.origin_y + (np.arange(self.rows) + 0.5) * self.resolution

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max in m (the order matplotlib wants)."""
        return (
            self.origin_x,
            self.origin_x + self.cols * self.resolution,
            self.origin_y,
            self.origin_y + self.rows * self.resolution,
        )

    def cell(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of points (m); may lie outside, see `contains`."""
        col = np.floor((np.asarray(x, float) - self.origin_x) / self.resolution).astype(np.int64)
        row = np.floor((np.asarray(y, float) - self.origin_y) / self.resolution).astype(np.int64)
        return row, col

    def contains(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """Whether points (m, work frame) lie on a cell of the grid; bool of the shape of x and y."""
        row, col = self.cell(x, y)
        return (row >= 0) & (row < self.rows) & (col >= 0) & (col < self.cols)


@dataclass(frozen=True)
class HeightGrid:
    """Heights on a GridSpec."""

    spec: GridSpec
    z: np.ndarray  # (rows, cols) m, NaN = unknown
    sigma: np.ndarray | None = None  # (rows, cols) m, standard uncertainty; None = not known

    def __post_init__(self) -> None:
        if self.z.shape != self.spec.shape:
            raise GridError(f'heights have shape {self.z.shape}, the grid {self.spec.shape}')
        if self.sigma is not None and self.sigma.shape != self.spec.shape:
            raise GridError(f'sigma has shape {self.sigma.shape}, the grid {self.spec.shape}')

    @classmethod
    def full(cls, spec: GridSpec, value: float = np.nan) -> HeightGrid:
        """The same height (m) everywhere; unknown by default."""
        return cls(spec, np.full(spec.shape, value, float))

    @property
    def coverage(self) -> float:
        """Share of cells that are known, 0..1."""
        return float(np.isfinite(self.z).mean())

    def with_z(self, z: np.ndarray) -> HeightGrid:
        """Other heights (rows, cols) m on the same cells; sigma is kept. GridError for another shape."""
        return replace(self, z=z)

    def sample(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """Bilinear height at points (m); unknown cells carry no weight. NaN outside and where nothing known is near."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        spec = self.spec
        u = (x - spec.origin_x) / spec.resolution - 0.5
        v = (y - spec.origin_y) / spec.resolution - 0.5
        outside = ~((u >= -0.5) & (u <= spec.cols - 0.5) & (v >= -0.5) & (v <= spec.rows - 0.5))
        u = np.where(outside, 0.0, np.clip(u, 0, spec.cols - 1))
        v = np.where(outside, 0.0, np.clip(v, 0, spec.rows - 1))
        c0, r0 = np.floor(u).astype(int), np.floor(v).astype(int)
        c1, r1 = np.minimum(c0 + 1, spec.cols - 1), np.minimum(r0 + 1, spec.rows - 1)
        fu, fv = u - c0, v - r0
        total = np.zeros(x.shape)
        weight = np.zeros(x.shape)
        for r, c, w in (
            (r0, c0, (1 - fu) * (1 - fv)),
            (r0, c1, fu * (1 - fv)),
            (r1, c0, (1 - fu) * fv),
            (r1, c1, fu * fv),
        ):
            z = self.z[r, c]
            known = np.isfinite(z)
            total += np.where(known, z, 0.0) * w * known
            weight += w * known
        ok = (weight > 1e-9) & ~outside
        return np.where(ok, total / np.where(ok, weight, 1.0), np.nan)

    def save_npz(self, path: str | Path) -> None:
        """One file with everything, readable by numpy alone (keys z, sigma, origin, resolution; m)."""
        s = self.spec
        sigma = np.full(s.shape, np.nan) if self.sigma is None else self.sigma
        np.savez_compressed(
            path,
            z=self.z,
            sigma=sigma,
            origin=np.array([s.origin_x, s.origin_y]),
            resolution=np.array(s.resolution),
        )

    @classmethod
    def load_npz(cls, path: str | Path) -> HeightGrid:
        """Reads what `save_npz` wrote; a sigma that is NaN everywhere becomes None. KeyError for other npz files,
        FileError for a damaged one."""
        f = read_npz(Path(path))
        z, origin = f['z'], f['origin']
        spec = GridSpec(float(origin[0]), float(origin[1]), float(f['resolution']), *z.shape)
        sigma = f['sigma'] if np.isfinite(f['sigma']).any() else None
        return cls(spec, z, sigma)
