"""What the scanner sees beside the arc while a layer is laid: which cells show ground, which show finished metal, and
how far either is from what it should be. Pure; maps are (rows, cols), m, work frame.

A cell shows something only while no bead is near it: before the first segment that reaches it, or after the last one.
What is seen in between is half of a bead and tells nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

NEAR = 0.75  # bead widths from its path within which a bead changes the surface
STEP = 1e-3  # m between the points of a path that cells are compared with
MOST = 200.0  # points of older looks that count against a new one
ABSURD = 3e-3  # m; a surface that is off by more is another one
WELL = 8  # points of a cell that a scan pass need not see again; the pass itself has some 12
HOLE = 2  # cells, widest hole in what was seen that is filled in
NONE = -1


@dataclass(frozen=True)
class Look:
    """What was seen since the look before: z (rows, cols) m, NaN = nothing; count: points behind each cell."""

    z: np.ndarray
    count: np.ndarray


@dataclass(frozen=True)
class BesideArc:
    """What was seen finished of a layer while it was laid: z (rows, cols) m where it was seen well, NaN elsewhere;
    covered (rows, cols): seen at all."""

    z: np.ndarray
    covered: np.ndarray


@dataclass(frozen=True)
class Reach:
    """Per cell (rows, cols) the index of a segment: first and last one whose bead changes it (NONE = none does), and
    the nearest one."""

    first: np.ndarray
    last: np.ndarray
    nearest: np.ndarray

    @classmethod
    def of(cls, segments: list[Segment], spec: GridSpec, bead_width: float) -> Reach:
        """Of the deposits among the segments of a layer; at least one."""
        points, index = _points([s for s in segments if s.kind == Kind.DEPOSIT])
        x, y = np.meshgrid(spec.x, spec.y)
        cells = np.stack([x.ravel(), y.ravel()], axis=1)
        nearest = index[cKDTree(points).query(cells)[1]].reshape(spec.shape)
        reach = NEAR * bead_width
        cell = cKDTree(cells)
        first, last = (np.full(len(cells), v, np.int64) for v in (np.iinfo(np.int64).max, NONE))
        near = cell.query_ball_point(points, reach)
        lengths = np.fromiter(map(len, near), np.int64, len(near))
        hit = np.concatenate([np.asarray(n, np.int64) for n in near])
        who = np.repeat(index, lengths)
        np.minimum.at(first, hit, who)
        np.maximum.at(last, hit, who)
        first[last == NONE] = NONE
        return cls(first.reshape(spec.shape), last.reshape(spec.shape), nearest)


def _points(deposits: list[Segment]) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) m on the paths and the index (n,) of the segment that each belongs to."""
    points, index = [], []
    for s in deposits:
        n = max(1, int(np.ceil(s.length / STEP)))
        a, b = np.array(s.start[:2]), np.array(s.end[:2])
        points.append(a + (np.arange(n)[:, None] + 0.5) / n * (b - a))
        index += [s.index] * n
    return np.concatenate(points), np.array(index, np.int64)


class SeenLayer:
    """Collects looks. `ground`, `growth` (deviations, m), `count`, `when` (s), and `z` of what was seen (m)."""

    def __init__(self, before: np.ndarray, reach: Reach) -> None:
        shape = before.shape
        self.before, self.reach = before, reach
        self.ground, self.growth, self.z = (np.full(shape, np.nan) for _ in range(3))
        self.count, self.when = np.zeros(shape), np.full(shape, -np.inf)
        self._altered = np.zeros(int(reach.last.max()) + 2, bool)  # by index of the segment

    def altered(self, first: int, last: int) -> None:
        """Segments first .. last were laid with other metal than they were given: nothing is learned from them."""
        self._altered[max(first, 0) : last + 1] = True

    def add(self, look: Look, began: int, done: int, asked: np.ndarray, now: float) -> int:
        """A look at what was seen from segment `began` executed to segment `done` executed; asked: metal that the
        setpoints ask for, m. Returns how many cells told something."""
        first, last = self.reach.first, self.reach.last
        seen = np.isfinite(look.z)
        untouched = seen & ((first == NONE) | (first > done + 1))
        finished = seen & (last != NONE) & (last <= began) & ~self._odd()
        told = 0
        for which, kept, wanted in (
            (untouched, self.ground, self.before),
            (finished, self.growth, self.before + asked),
        ):
            off = look.z - wanted
            told += self._mix(which & (np.abs(off) <= ABSURD), kept, off, look, now)
        self.ground[finished] = np.nan
        return told

    def _odd(self) -> np.ndarray:
        """(rows, cols) bool, cells with metal of an altered segment."""
        total = np.concatenate([[0], np.cumsum(self._altered)])
        first, last = np.maximum(self.reach.first, 0), np.maximum(self.reach.last, 0)
        return total[last + 1] - total[first] > 0

    def _mix(
        self, which: np.ndarray, kept: np.ndarray, off: np.ndarray, look: Look, now: float
    ) -> int:
        fresh = which & ~np.isfinite(kept)
        self.count[fresh] = 0.0
        old, new = np.minimum(self.count[which], MOST), look.count[which].astype(float)
        share = new / np.maximum(old + new, 1e-9)
        for values, seen in ((kept, off), (self.z, look.z)):
            values[fresh] = seen[fresh]
            values[which] += share * (seen[which] - values[which])
        self.count[which] = old + new
        self.when[which] = now
        return int(which.sum())

    def age(self, now: float) -> np.ndarray:
        """(rows, cols) s since a cell was last seen; a large number where it never was."""
        return np.minimum(now - self.when, 1e6)

    def share(self, planned: np.ndarray) -> float:
        """0..1 of the footprint that was seen, before or after its metal was laid."""
        metal = np.nan_to_num(planned) > 0
        return float((np.isfinite(self.z) & metal).sum() / max(int(metal.sum()), 1))

    def final(self) -> BesideArc:
        """The surface where it was seen after everything that was to come there."""
        ready = np.isfinite(self.growth) | (np.isfinite(self.ground) & (self.reach.first == NONE))
        return BesideArc(
            without_holes(np.where(ready & (self.count >= WELL), self.z, np.nan)), ready
        )


def without_holes(z: np.ndarray) -> np.ndarray:
    """(rows, cols) m, with holes (NaN) of up to HOLE cells along x filled in between what is on both sides: a profile
    that was lost leaves one."""
    out, cols = z.copy(), z.shape[1]
    padded = np.pad(z, ((0, 0), (HOLE, HOLE)), constant_values=np.nan)
    for left in range(1, HOLE + 1):
        for right in range(1, HOLE + 2 - left):
            a = padded[:, HOLE - left : HOLE - left + cols]
            b = padded[:, HOLE + right : HOLE + right + cols]
            between = (right * a + left * b) / (left + right)
            out = np.where(np.isnan(out), between, out)
    return out
