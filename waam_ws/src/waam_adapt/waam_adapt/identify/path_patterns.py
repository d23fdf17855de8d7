"""Kinds of layers: paths of another pattern give another level.

Programs of others change the pattern from layer to layer, rings here and a slanted zig-zag there. As much wire gives
less height in one than in the other: metal runs off the edges, arcs start more often. An efficiency that is followed
from layer to layer would always be that of the pattern before. Here each pattern has its own share of it, which is
taken off what the layer shows. In plans of our own one pattern follows another for good, and nobody can say whether it
is the pattern or the process that has changed: there everything is the process (docs/adaptation.md).

A pattern is told by how much of its path runs at which angle to the axes of the map, whatever the quadrant: zig-zags
along x and along y are one kind, and so are those that run to the left and to the right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

BINS = 4  # of the angle, from 0 to 45 degrees
MAX_DIFFERENCE = 0.3  # share of the path by which layers of one kind may differ
OFFSET_SIGMA = 0.05  # of a kind's offset before any layer of it, relative
MAX_OFFSET = 0.15  # an offset beyond this is a fault


def pattern(paths: tuple[np.ndarray, ...]) -> np.ndarray:
    """Share of the length at each angle (BINS,) of beads (n, >= 2), corners one after the other; 0 without a length."""
    found = np.zeros(BINS)
    for path in paths:
        way = np.diff(path[:, :2], axis=0)
        angle = np.arctan2(np.abs(way[:, 1]), np.abs(way[:, 0]))
        folded = np.minimum(angle, np.pi / 2 - angle) / (np.pi / 4)
        at = np.clip((folded * BINS).astype(int), 0, BINS - 1)
        found += np.bincount(at, np.hypot(*way.T), BINS)
    return found / max(float(found.sum()), 1e-12)


@dataclass(frozen=True)
class PathPatterns:
    """What is known of each kind, one entry per kind: its pattern, by how much its efficiency lies off the process'
    (relative), and the variance of that."""

    patterns: tuple[np.ndarray, ...] = ()
    offsets: tuple[float, ...] = ()
    variances: tuple[float, ...] = ()

    def index(self, paths: tuple[np.ndarray, ...]) -> int | None:
        """The kind that these beads are of; None = a new one, or no beads."""
        own = pattern(paths)
        away = [0.5 * float(np.abs(own - p).sum()) for p in self.patterns]
        if not away or not own.any() or min(away) > MAX_DIFFERENCE:
            return None
        return int(np.argmin(away))

    def offset(self, paths: tuple[np.ndarray, ...]) -> float:
        """Relative, of the efficiency; 0 of a kind that was never laid."""
        k = self.index(paths)
        return 0.0 if k is None else self.offsets[k]

    def learn(
        self, paths: tuple[np.ndarray, ...], difference: float, variance: float
    ) -> PathPatterns:
        """With one more layer. difference: of its efficiency from the one expected of it, relative; variance: of that
        without the kind's own. With one kind alone everything is the process."""
        if not paths or not pattern(paths).any():
            return self
        k = self.index(paths)
        known = self
        if k is None:
            k = len(self.patterns)
            known = PathPatterns(
                (*self.patterns, pattern(paths)),
                (*self.offsets, 0.0),
                (*self.variances, OFFSET_SIGMA**2),
            )
        if len(known.patterns) < 2:
            return known
        gain = known.variances[k] / (known.variances[k] + variance)
        offset = min(max(known.offsets[k] + gain * difference, -MAX_OFFSET), MAX_OFFSET)
        return replace(
            known,
            offsets=_with(known.offsets, k, offset),
            variances=_with(known.variances, k, (1 - gain) * known.variances[k]),
        )


def _with(values: tuple[float, ...], index: int, value: float) -> tuple[float, ...]:
    return (*values[:index], value, *values[index + 1 :])
