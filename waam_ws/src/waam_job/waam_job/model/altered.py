"""Metal that the operator's override adds to a layer or takes from it. It is wanted: the layer counts as asked for it,
so neither the identification nor the next layer takes it back as an error of the process."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

MIN_ALTERED = 1e-3  # of the metal: less is not told
KEPT_S = 3.0  # s between two records of a layer that is being laid with an override


class AlteredMetal:
    """Of one layer. segments: as they are laid, in the frame of the grid; earlier: deposits that lay there before a
    layer that was cut off went on, with the metal that is on record for them."""

    def __init__(self, segments: Sequence[Segment], earlier: Sequence[Segment] = ()) -> None:
        self._deposits = [s for s in segments if s.kind == Kind.DEPOSIT]
        self._earlier = list(earlier)
        self._next = segments[0].index
        self._factor = np.ones(len(segments) + 1)
        self._first = segments[0].index
        self._kept, self._kept_at = 1.0, 0.0

    def heard(self, done: int, factor: float) -> None:
        """Segments up to number `done` are finished. factor: metal per length of path since the last call over what was
        set; the segment that runs has it as well."""
        if factor != 1.0:
            begin, end = self._next - self._first, done + 2 - self._first
            self._factor[max(begin, 0) : end] = factor
        self._next = max(self._next, done + 1)

    def news(self, factor: float, now: float) -> bool:
        """Whether what is on record should be renewed at `now` (s): `factor` is not that of the last call, or it is not
        1 and the record is KEPT_S old."""
        if factor == self._kept and (factor == 1.0 or now - self._kept_at < KEPT_S):
            return False
        self._kept, self._kept_at = factor, now
        return True

    @property
    def _of_deposits(self) -> np.ndarray:
        return self._factor[[s.index - self._first for s in self._deposits]]

    @property
    def text(self) -> str:
        """For the layer report; '' = nothing was altered."""
        factor = self._of_deposits
        changed = np.abs(factor - 1) > MIN_ALTERED
        if not changed.any():
            return ''
        length = np.array([s.length for s in self._deposits])
        share = length[changed].sum() / length.sum()
        mean = float((factor * length)[changed].sum() / length[changed].sum())
        return f'override: {share:.0%} of the layer was laid with {mean:.2f} of its metal, which counts as asked for'

    def asked(self, asked: np.ndarray, spec: GridSpec) -> np.ndarray:
        """Metal asked for (rows, cols) m with the override: every cell that of the nearest deposit."""
        if not self.text:
            return asked
        rows, cols = np.nonzero(asked > 0)
        factor = np.append(self._of_deposits, np.ones(len(self._earlier)))
        out = asked.copy()
        out[rows, cols] *= factor[self._nearest(spec, rows, cols)]
        return out

    def with_earlier(self, asked: np.ndarray, on_record: np.ndarray, spec: GridSpec) -> np.ndarray:
        """Metal asked for (rows, cols) m, that `on_record` where the nearest deposit is an earlier one."""
        if not self._earlier or not self._deposits:
            return on_record if self._earlier else asked
        rows, cols = np.indices(asked.shape).reshape(2, -1)
        old = (self._nearest(spec, rows, cols) >= len(self._deposits)).reshape(asked.shape)
        return np.where(old, on_record, asked)

    def _nearest(self, spec: GridSpec, rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
        points = np.array([s.midpoint[:2] for s in [*self._deposits, *self._earlier]])
        return cKDTree(points).query(np.stack([spec.x[cols], spec.y[rows]], axis=1))[1]
