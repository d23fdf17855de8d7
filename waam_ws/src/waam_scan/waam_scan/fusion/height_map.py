"""Streaming fusion of profile points into one height per cell.

Any number of points in bounded memory, and the same map to the last bit in whatever order, batches or threads they came
(`kernels.py`). A cell's height comes from all of its points, by an estimator that spikes hardly move
(`cell_kernels.py`). A cell that no point fell into stays NaN; nothing is filled in.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from ..transform import Mounting
from .accumulator import Accumulator, Workers
from .heights import CellHeights
from .kernels import UNITS, read_only, rows_seen
from .limits import FusionLimits

PARALLEL_FROM = 200_000  # points of a batch that are worth a second thread
MIN_PERIOD = 1.6384e-3  # m: wide against noise, narrow against spikes; height unit 0.1 um
# coarse cells need a longer period, because their points lie higher and lower on a slope
CELLS_PER_PERIOD = 0.25


@dataclass(frozen=True)
class FusedMap:
    """A fused surface. Maps are (rows, cols), float32 and in m unless said otherwise."""

    spec: GridSpec
    z: np.ndarray  # height, NaN = never seen
    sigma: np.ndarray  # standard uncertainty
    count: np.ndarray  # uint16, points that support the cell; 65535 = that many or more
    scatter: np.ndarray  # robust scatter of the points in a cell about the local slope
    share: np.ndarray  # of the points in a cell that support it
    coverage: float  # known share of the cells
    residual: float  # m, typical scatter of points in a cell
    points_used: int  # points that support a cell
    dropouts: int  # points without a return
    outside: int  # points beside the grid or its heights
    spikes: int  # points that do not agree with their cell

    @property
    def points_rejected(self) -> int:
        """Drop-outs, points beside the grid and spikes together."""
        return self.dropouts + self.outside + self.spikes

    @property
    def grid(self) -> HeightGrid:
        """The map with its sigma as float64, m."""
        return HeightGrid(self.spec, self.z.astype(float), self.sigma.astype(float))


@dataclass
class Fusion:
    """One map under construction. Call `add` for every batch of profiles, `result` whenever a map is wanted.

    threads: for large batches and for the result; they only change the speed.
    """

    spec: GridSpec
    mounting: Mounting = field(default_factory=Mounting)
    limits: FusionLimits = field(default_factory=FusionLimits)
    threads: int = 1

    def __post_init__(self) -> None:
        limits = self.limits
        if not limits.height_min < limits.height_max:
            raise ValueError(
                f'height_min {limits.height_min} m must be below height_max {limits.height_max} m'
            )
        self._unit = max(MIN_PERIOD, self.spec.resolution / CELLS_PER_PERIOD) / UNITS
        self._parts = [self._accumulator()]
        self._heights = CellHeights(self._parts[0])
        self._workers = Workers(self.threads)
        self.points = self.dropouts = self.outside = self.profiles = 0

    def _accumulator(self) -> Accumulator:
        limits = self.limits
        return Accumulator(
            self.spec, limits.slots, limits.height_min, limits.height_max, self._unit,
            turned=self.mounting.along_rows,
        )  # fmt: skip

    @property
    def memory(self) -> int:
        """Bytes held; does not grow with the number of points (a second thread doubles it once)."""
        return sum(p.nbytes for p in self._parts) + self._heights.nbytes

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
        origins, axis = self._in_cells(self.mounting.origins(tcp))
        threads = self.threads if x.size >= PARALLEL_FROM else 1
        while len(self._parts) < threads:
            self._parts.append(self._accumulator())
        edges = np.linspace(0, len(x), threads + 1).astype(int)
        work = [
            (part, slice(a, b))
            for part, a, b in zip(self._parts, edges, edges[1:], strict=False)
            if b > a
        ]
        counts = self._workers.run(lambda p, s: p.add(origins[s], axis, x[s], z[s]), work)
        self.points += x.size
        self.profiles += len(x)
        self.dropouts += sum(c[0] for c in counts)
        self.outside += sum(c[1] for c in counts)

    def _in_cells(self, origins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scanner origins (n, 3) as columns, rows, m and what a metre of scanner x and z adds to them (6,), float32."""
        spec, scale = self.spec, np.array([1 / self.spec.resolution] * 2 + [1.0])
        corner = np.array([spec.origin_x, spec.origin_y, 0.0])
        axis = np.concatenate([self.mounting.rotation[:, k] * scale for k in (0, 2)])
        return ((origins - corner) * scale).astype(np.float32), axis.astype(np.float32)

    def merge(self, other: Fusion) -> None:
        """Takes over all that `other` (another scanner, another pass) saw of the same grid; `other` is empty
        afterwards.

        ValueError when grid or limits differ.
        """
        if (self.spec, self.limits) != (other.spec, other.limits):
            raise ValueError('only maps of the same grid and limits can be merged')
        for part in other._parts:
            self._take_over(part.laid_out(self._parts[0].turned))
        other._parts = [other._accumulator()]
        other._heights = CellHeights(other._parts[0])
        for name in ('points', 'dropouts', 'outside', 'profiles'):
            setattr(self, name, getattr(self, name) + getattr(other, name))
            setattr(other, name, 0)

    def _take_over(self, part: Accumulator) -> None:
        first = self._parts[0]
        ranges = self._workers.parts(len(first.words))
        self._workers.run(lambda a, b: first.take_over(part, a, b), ranges)

    def refresh(self) -> None:
        """Does the part of `result` that need not be repeated for cells that get no more points."""
        for part in self._parts[1:]:
            self._take_over(part)
        self._heights.refresh(self._workers)

    def result(self) -> FusedMap:
        """The map of everything added so far; more may be added afterwards."""
        self.refresh()
        cells = self._parts[0]
        crop = cells.on_grid
        h = self._heights.finish(self._workers, self.limits)
        z, sigma, scatter, used = (crop(a) for a in (h.z, h.sigma, h.scatter, h.used))
        seen = crop(cells.words[:, 0])
        points_used = int(used.sum())
        known = np.isfinite(z)
        return FusedMap(
            spec=self.spec,
            z=z.astype(np.float32),
            sigma=sigma.astype(np.float32),
            count=np.minimum(used, 65535).astype(np.uint16),
            scatter=np.where(known, scatter, np.nan).astype(np.float32),
            share=(used / np.maximum(seen, 1)).astype(np.float32),
            coverage=float(known.mean()),
            residual=h.residual,
            points_used=points_used,
            dropouts=self.dropouts,
            outside=self.outside,
            spikes=int(seen.sum()) - points_used,
        )


def warm_up() -> None:
    """Compiles all loops, so that the first scan does not wait for it (some 10 s, then cached on disk)."""
    fusion = Fusion(GridSpec(0.0, 0.0, 1e-3, 4, 4), Mounting(np.zeros(3)))
    x = np.full((1, 8), 1e-3, np.float32)
    if rows_seen(read_only(x), read_only(x)).all():
        fusion.add(np.zeros((1, 3)), x, x)
    fusion.merge(Fusion(fusion.spec, fusion.mounting))
    fusion.result()
