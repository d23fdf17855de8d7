"""From what the cells hold to heights, in stages; the first two are remembered for cells that do not change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import cell_kernels as ck
from .accumulator import Accumulator, Workers
from .kernels import UNITS
from .limits import FusionLimits

MIN_CELLS = 20  # cells with enough samples, before the map's own scatter is believed
NEEDLE = 6.0  # cells; nothing in one cell stands so far above or below all of its neighbours
WITNESSES = 50_000  # cells from which the scatter of the map is estimated; more do not improve it
PLAUSIBLE_RATIO = 9.0  # cells whose variance is further above the median are edges and left out of the noise estimate


@dataclass(frozen=True)
class Heights:
    """One value per cell (cells,), and the scatter of the map."""

    z: np.ndarray  # m
    sigma: np.ndarray  # m, standard uncertainty
    scatter: np.ndarray  # m, of the samples
    used: np.ndarray  # points
    residual: float  # m, NaN while too few cells have samples


class CellHeights:
    """Heights of the cells of one accumulator. Arrays are (cells,), float64, m unless said otherwise."""

    def __init__(self, cells: Accumulator) -> None:
        self._cells = cells
        n = len(cells.words)
        self._done = np.zeros(n, np.uint64)  # points at the last look
        self._median, self._wave, self._best = np.full((3, n), np.nan)
        self._mean_u, self._mean_v, self._gx, self._gy = np.zeros((4, n))  # cells; m per cell
        self._done_slope = np.zeros((n, 3))
        self._level, self._scatter = np.full((2, n), np.nan)
        self._z, self._sigma, self._mean, self._squares = np.empty((4, n))
        self._kept, self._used = np.zeros((2, n), np.int64)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(a.nbytes for a in vars(self).values() if isinstance(a, np.ndarray))

    def refresh(self, workers: Workers) -> None:
        """Medians, sine estimates, slopes and scatters."""
        c = self._cells
        low = float(c.low)
        parts = workers.parts(len(c.words))
        workers.run(
            lambda a, b: ck.levels(
                start=a, stop=b, words=c.words, halves=c.halves, rows=c.rows, sums=c.sums, low=low, unit=c.unit,
                done=self._done, median=self._median, wave=self._wave, mean_u=self._mean_u, mean_v=self._mean_v,
            ),
            parts,
        )  # fmt: skip
        np.copyto(self._best, self._median)
        np.copyto(self._best, self._wave, where=np.isfinite(self._wave))
        best, gx, gy = (c.in_lines(a) for a in (self._best, self._gx, self._gy))
        along, across = (gy, gx) if c.turned else (gx, gy)
        workers.run(
            lambda a, b: ck.slopes(a, b, best, c.per_line, along, across),
            workers.parts(c.lines, c.stride),
        )
        workers.run(
            lambda a, b: ck.scatters(
                start=a, stop=b, words=c.words, halves=c.halves, rows=c.rows, low=low, unit=c.unit, gx=self._gx,
                gy=self._gy, done=self._done_slope, level=self._level, scatter=self._scatter,
            ),
            parts,
        )  # fmt: skip

    def finish(self, workers: Workers, limits: FusionLimits) -> Heights:
        """Heights and uncertainties after a `refresh`."""
        c = self._cells
        low, best = float(c.low), c.in_lines(self._best)
        parts = workers.parts(len(c.words))
        enough = self._witnesses()
        rough = self._rough(enough, limits.noise)
        workers.run(
            lambda a, b: ck.inliers(
                start=a, stop=b, halves=c.halves, rows=c.rows, low=low, unit=c.unit, height=best, cols=c.per_line,
                gx=self._gx, gy=self._gy, level=self._level, scatter=self._scatter, pooled=rough,
                factor=float(limits.spike_factor), support=float(limits.support), needle=NEEDLE * c.spec.resolution,
                kept=self._kept, mean=self._mean, squares=self._squares,
            ),
            parts,
        )  # fmt: skip
        residual = self._pooled(enough)
        pooled = residual if np.isfinite(residual) and residual > 0 else limits.noise
        pull = self._pull(float(c.unit) * UNITS)
        workers.run(
            lambda a, b: ck.heights(
                start=a, stop=b, words=c.words, halves=c.halves, wave=self._wave, mean_u=self._mean_u,
                mean_v=self._mean_v, gx=self._gx, gy=self._gy, level=self._level, kept=self._kept, mean=self._mean,
                squares=self._squares, pooled=pooled, pull=pull, z=self._z, sigma=self._sigma, used=self._used,
            ),
            parts,
        )  # fmt: skip
        return Heights(self._z, self._sigma, self._scatter, self._used, residual)

    def _witnesses(self) -> np.ndarray:
        """Cells whose samples give the scatter, in the order of the grid, whatever their layout in memory."""
        c = self._cells
        good = c.in_lines(c.halves[:, 7] >= ck.MIN_SAMPLES_OF_SCATTER)
        if c.turned:
            place, line = np.nonzero(good.T)
        else:
            line, place = np.nonzero(good)
        return (line * c.stride + place)[:: 1 + len(line) // WITNESSES]

    def _rough(self, enough: np.ndarray, noise: float) -> float:
        """First idea of the scatter (m) from medians alone, of the cells `enough`: decides about spikes."""
        known = self._scatter[enough]
        rough = float(np.median(known)) if len(known) >= MIN_CELLS else 0.0
        return rough if rough > 0 else noise

    def _pooled(self, enough: np.ndarray) -> float:
        """Standard deviation (m) of the inliers of the cells `enough` but edges; NaN when there is none."""
        good = enough[self._kept[enough] >= ck.MIN_SAMPLES_OF_SCATTER]
        if not len(good):
            return float('nan')
        squares, freedom = self._squares[good], self._kept[good] - 1
        variance = squares / freedom
        flat = variance <= PLAUSIBLE_RATIO * np.median(variance)
        return float(np.sqrt(squares[flat].sum() / freedom[flat].sum()))

    def _pull(self, period: float) -> float:
        """Variance (m²) that spikes at random heights add to a point of the sine estimate."""
        seen = int(self._cells.halves[:, 7].sum())
        share = 1.0 - self._kept.sum() / seen if seen else 0.0
        return 0.5 * share * (period / (2 * np.pi)) ** 2
