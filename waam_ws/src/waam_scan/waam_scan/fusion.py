"""Streaming fusion of profile points into one height per cell.

Any number of points in bounded memory, and the same map to the last bit in whatever order the profiles came. Per cell:
a sample of its points (see `kernels.py`), their median, the local slope from the neighbours' medians, and the mean of
the inliers reduced to the cell centre. A cell that no point fell into stays NaN; nothing is filled in.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from . import kernels
from .transform import Mounting


@dataclass(frozen=True)
class FusionLimits:
    """height_min, height_max: m, work frame, points beyond are counted as outside; noise: m, expected scatter of the
    scanner, used while the data cannot tell; spike_factor: points further from the cell's level than this many robust
    standard deviations are spikes; support: m, cells with fewer than four points need a neighbour this close in height;
    slots: points kept per cell."""

    height_min: float = -0.05
    height_max: float = 0.30
    noise: float = 50e-6
    spike_factor: float = 4.0
    support: float = 0.6e-3
    slots: int = 16


@dataclass(frozen=True)
class FusedMap:
    """A fused surface. z, sigma: (rows, cols) float32, m, NaN = never seen; count: (rows, cols) uint16 points that
    support the cell; coverage: known share of the cells; residual: m, robust scatter of points about their cell's
    height; the rest counts points."""

    spec: GridSpec
    z: np.ndarray
    sigma: np.ndarray
    count: np.ndarray
    coverage: float
    residual: float
    points_used: int
    dropouts: int
    outside: int
    spikes: int

    @property
    def points_rejected(self) -> int:
        return self.dropouts + self.outside + self.spikes

    @property
    def grid(self) -> HeightGrid:
        return HeightGrid(self.spec, self.z.astype(float), self.sigma.astype(float))


@dataclass
class Fusion:
    """One map in the making. `add` as often as profiles come, `result` whenever a map is wanted."""

    spec: GridSpec
    mounting: Mounting = field(default_factory=Mounting)
    limits: FusionLimits = field(default_factory=FusionLimits)

    def __post_init__(self) -> None:
        cells, slots = self.spec.rows * self.spec.cols, self.limits.slots
        self._count = np.zeros(cells, np.int64)
        self._top = np.zeros(cells, np.uint64)
        self._keys = np.empty((cells, slots), np.uint64)
        self._samples = np.empty((cells, slots, 3), np.float32)
        self.points = self.dropouts = self.outside = self.profiles = 0

    @property
    def memory(self) -> int:
        """Bytes held; does not grow with the number of points."""
        return sum(a.nbytes for a in (self._count, self._top, self._keys, self._samples))

    def add(self, tcp: np.ndarray, x: np.ndarray, z: np.ndarray) -> None:
        """Profiles x, z (n, m) in m, scanner frame, NaN = no return, taken at wire tip positions tcp (n, 3) in m, work.

        ValueError when shapes do not fit or a position is not finite.
        """
        x, z = (np.ascontiguousarray(a, np.float32) for a in (x, z))
        tcp = np.ascontiguousarray(tcp, float)
        if x.ndim != 2 or x.shape != z.shape or tcp.shape != (len(x), 3):
            raise ValueError(
                f'profiles x {x.shape}, z {z.shape} and positions {tcp.shape} do not fit'
            )
        if not np.isfinite(tcp).all():
            raise ValueError('a profile without a pose cannot be fused (position is not finite)')
        origins = self.mounting.origins(tcp)
        rotation, spec, limits = self.mounting.rotation, self.spec, self.limits
        dropouts, outside = kernels.add_profiles(
            origins, _origin_keys(origins), rotation[:, 0].copy(), rotation[:, 2].copy(),
            x, z, x.view(np.uint32), z.view(np.uint32),
            np.array([spec.origin_x, spec.origin_y], float), float(spec.resolution), spec.rows, spec.cols,
            float(limits.height_min), float(limits.height_max), self._count, self._top, self._keys, self._samples,
        )  # fmt: skip
        self.points += x.size
        self.profiles += len(x)
        self.dropouts += dropouts
        self.outside += outside

    def result(self) -> FusedMap:
        """The map of everything added so far; more may be added afterwards."""
        cells, shape = self._count.size, self.spec.shape
        kernels.sort_samples(self._count, self._keys, self._samples)
        medians, gx, gy, levels, scatter, z, sigma = np.zeros((7, cells))
        used = np.zeros(cells, np.int64)
        kernels.cell_medians(self._count, self._samples, medians)
        medians = medians.reshape(shape)
        kernels.slopes(medians, gx.reshape(shape), gy.reshape(shape))
        kernels.cell_scatter(self._count, self._samples, gx, gy, levels, scatter)
        pooled, residual = self._pooled(scatter)
        kernels.cell_means(
            self._count, self._samples, medians, gx, gy, levels, scatter, pooled,
            float(self.limits.spike_factor), float(self.limits.support), z, sigma, used,
        )  # fmt: skip
        return FusedMap(
            spec=self.spec,
            z=z.reshape(shape).astype(np.float32),
            sigma=sigma.reshape(shape).astype(np.float32),
            count=np.minimum(used, 65535).reshape(shape).astype(np.uint16),
            coverage=float(np.isfinite(z).mean()),
            residual=residual,
            points_used=int(used.sum()),
            dropouts=self.dropouts,
            outside=self.outside,
            spikes=int(self._count.sum() - used.sum()),
        )

    def _pooled(self, scatter: np.ndarray) -> tuple[float, float]:
        """Typical scatter (m) from the cells that have enough points: what decides about spikes, and what is reported
        (NaN when no cell has enough)."""
        known = scatter[self._count >= kernels.ENOUGH]
        residual = float(np.median(known)) if len(known) else float('nan')
        return (residual if len(known) >= 20 and residual > 0 else self.limits.noise), residual


def _origin_keys(origins: np.ndarray) -> np.ndarray:
    """(n,) uint64 from the bits of the origins (n, 3): tells points of different profiles apart in the hash."""
    bits = np.ascontiguousarray(origins, float).view(np.uint64)
    odd = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    return np.bitwise_xor.reduce(bits * odd, axis=1)


def warm_up() -> None:
    """Compiles the loops, so that the first scan does not wait for it (about 2 s, then cached on disk)."""
    fusion = Fusion(GridSpec(0.0, 0.0, 1e-3, 4, 4), Mounting(np.zeros(3)))
    fusion.add(np.zeros((1, 3)), np.full((1, 8), 1e-3), np.full((1, 8), 1e-3))
    fusion.result()
