"""What a map under construction stores per cell, and how points are added. Memory depends on the grid alone."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from waam_process.grid import GridSpec

from . import kernels

PAD = 3  # unused cells at the end of a line, so that a profile across lines does not fall into one cache set
CELLS_PER_THREAD = 50_000  # less work is done before another thread is awake
TABLE = kernels.phase_table()


class Accumulator:
    """Integer sums and a sample of points per cell of `spec`.

    slots: points in the sample; low, high: m, limits of height; unit: m, height resolution. turned: the cells of a
    column lie side by side in memory, not those of a row. Along the profiles this saves half of the time when they
    come in any order; it changes no result.
    words: (cells, 4) uint64 count, phase sums, place sums, threshold and size of the sample; sums: (cells, 4) int64
    that take over before 32 bits overflow; rows: (cells, slots) uint64 records, height << 32 | place v << 16 | place u.
    """

    def __init__(
        self, spec: GridSpec, slots: int, low: float, high: float, unit: float, turned: bool = False
    ) -> None:
        self.spec, self.turned = spec, turned
        self.lines, self.per_line = (spec.cols, spec.rows) if turned else spec.shape
        self.stride = self.per_line + PAD
        self.low, self.high, self.unit = np.float32(low), np.float32(high), unit
        cells = self.lines * self.stride
        self.words = np.zeros((cells, 4), np.uint64)
        self.halves = self.words.view(np.uint32)  # [:, 6] threshold, [:, 7] size of the sample
        self.halves[:, 6] = kernels.OPEN
        self.sums = np.zeros((cells, 4), np.int64)
        self.rows = np.zeros((cells, slots), np.uint64)

    @property
    def nbytes(self) -> int:
        """Bytes of all that is kept per cell."""
        return self.words.nbytes + self.sums.nbytes + self.rows.nbytes

    def add(self, origins: np.ndarray, axis: np.ndarray, x: np.ndarray, z: np.ndarray) -> tuple:
        """Profiles x, z (n, m) float32, m, with origins (n, 3) float32 in cells, cells, m and the scanner's axes
        (6,) float32: what a metre of x and of z adds to them. Returns (drop-outs, points outside)."""
        spec, f = self.spec, np.float32
        x, z = kernels.read_only(x), kernels.read_only(z)
        steps = (self.stride, 1) if self.turned else (1, self.stride)
        size = (f(spec.cols), f(spec.rows), np.int32(steps[0]), np.int32(steps[1]))
        return kernels.add_profiles(
            origins=origins, axis=axis, x=x, z=z, x_bits=x.view(np.uint32), z_bits=z.view(np.uint32), size=size,
            low=self.low, high=self.high, per_unit=f(1.0 / self.unit), table=TABLE, words=self.words,
            halves=self.halves, rows=self.rows, sums=self.sums,
        )  # fmt: skip

    def in_lines(self, values: np.ndarray) -> np.ndarray:
        """(cells, ...) as (lines, stride, ...): a view."""
        return values.reshape(self.lines, self.stride, *values.shape[1:])

    def on_grid(self, values: np.ndarray) -> np.ndarray:
        """(cells,) as (rows, cols): a view."""
        inner = self.in_lines(values)[:, : self.per_line]
        return inner.T if self.turned else inner

    def laid_out(self, turned: bool) -> Accumulator:
        """This one when its cells lie like that in memory, else a copy where they do."""
        if turned == self.turned:
            return self
        slots = self.rows.shape[1]
        low, high = float(self.low), float(self.high)
        other = Accumulator(self.spec, slots, low, high, self.unit, turned)
        for mine, its in (
            (self.words, other.words),
            (self.sums, other.sums),
            (self.rows, other.rows),
        ):
            source = self.in_lines(mine)[:, : self.per_line]
            other.in_lines(its)[:, : other.per_line] = source.swapaxes(0, 1)
        return other

    def take_over(self, other: Accumulator, start: int, stop: int) -> None:
        """Moves what `other` (same grid, limits and layout) holds of the cells start .. stop in here."""
        mine, theirs = ((a.words, a.halves, a.rows, a.sums) for a in (self, other))
        kernels.merge(
            start=start, stop=stop, words=mine[0], halves=mine[1], rows=mine[2], sums=mine[3], words2=theirs[0],
            halves2=theirs[1], rows2=theirs[2], sums2=theirs[3],
        )  # fmt: skip


class Workers:
    """Runs a compiled loop over parts of a range, one part per thread; the loops release the interpreter lock."""

    def __init__(self, threads: int) -> None:
        self.threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self.threads) if self.threads > 1 else None

    def parts(self, length: int, cells_each: int = 1) -> list[tuple[int, int]]:
        """The range 0 .. length in as many parts as are worth a thread; cells_each: cells per step of the range."""
        count = max(1, min(self.threads, length * cells_each // CELLS_PER_THREAD))
        edges = np.linspace(0, length, count + 1).astype(int)
        return [(int(a), int(b)) for a, b in zip(edges, edges[1:], strict=False)]

    def run(self, action: Callable, parts: list[tuple]) -> list:
        """action(*part) for every part; the results in their order."""
        if self._pool is None or len(parts) == 1:
            return [action(*p) for p in parts]
        return list(self._pool.map(lambda p: action(*p), parts))
