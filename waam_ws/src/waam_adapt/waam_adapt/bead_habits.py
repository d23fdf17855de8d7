"""What the beads of a job do that the nominal model does not: metal that comes late along the travel, and growth that
is missing at the same place again and again.

`shortfall` compares growth with what was asked of the same cell; that says nothing true where neighbouring pieces are
asked very different things, as at the ends of beads. Here growth is compared with what `BeadModel` expects.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from . import filters
from .bead_model import BeadModel
from .grids import CELLS_PER_BEAD

LAG_SIGMA = 0.3  # bead widths, of the lag before any layer
LAG_LIMITS = (-0.1, 0.5)  # bead widths
LAG_FORGETTING = 0.97  # per layer
ALIKE = 4.0  # neighbouring cells whose noise is one
INNER = 1.0  # bead widths from arc on and off, where the lag can be told from humps and craters
INNER_SHARE = 1 / 3  # of the learning rate there, for little comes back; the rest is noise
DRIFT, MAX_DRIFT = 0.15, 0.05  # weight of the newest layer in the surplus; most that is believed
MIN_CELLS = 50
MAX_MISSING = 1.0  # layer heights; more is a fault of the scan
SEEN = 0.3  # share of a cell that must be known


@dataclass(frozen=True)
class Learned:
    """For one layer: missing (rows, cols), share of the planned height that it will lack beside the model's growth;
    lag: m along the travel; slope: of growth on metal; scale: what the request's error was divided by for it."""

    missing: np.ndarray
    lag: float = 0.0
    slope: float = 1.0
    scale: float = 1.0


@dataclass(frozen=True)
class BeadHabits:
    """missing: maps on the model's grid of even and odd layers, None = never seen; layers: seen of each. lag and its
    information (1/variance) in bead widths. surplus: share of metal by which layers exceed what the flow factor allowed
    for; an efficiency that drifts, as in a part that heats up, is always a layer or two ahead of its estimate."""

    missing: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    layers: tuple[int, int] = (0, 0)
    lag: float = 0.0
    information: float = field(default=LAG_SIGMA**-2)
    surplus: float = 0.0

    def of(self, layer: int, shape: tuple[int, int]) -> np.ndarray:
        """What layer `layer` will lack; before its direction was ever seen, half of what the other one did."""
        own, other = self.missing[layer % 2], self.missing[1 - layer % 2]
        if own is None and other is not None:
            own = 0.5 * other
        return own if own is not None and own.shape == shape else np.zeros(shape)

    def learn(
        self,
        layer: int,
        model: BeadModel,
        asked: np.ndarray,
        growth: np.ndarray,
        seen: np.ndarray,
        learning: float,
        allowed: float | None = None,
    ) -> BeadHabits:
        """With one more layer, which counts at least `learning`. allowed: efficiency that the flow factor assumed.

        asked (n,): relative growth that the pieces should have given; growth (rows, cols) over the planned height; seen
        (rows, cols): share of the cells that is known and away from the edge.
        """
        expected = model.growth(asked, self.lag * model.width)
        known = (seen > SEEN) & (expected > SEEN)
        if np.count_nonzero(known) < MIN_CELLS:
            return self
        ratio = float(np.median(growth[known] / expected[known]))
        after = self._with_lag(model, asked, growth / ratio, expected, known)
        expected = model.growth(asked, after.lag * model.width)
        lacks = np.clip(np.where(known, ratio * expected - growth, 0.0), -MAX_MISSING, MAX_MISSING)
        if allowed is not None:
            news = float(np.clip(ratio / allowed - 1, -MAX_DRIFT, MAX_DRIFT))
            after = replace(after, surplus=self.surplus + DRIFT * (news - self.surplus))
        inner = (model.arc > INNER * model.width) & (filters.depth(known) > INNER * CELLS_PER_BEAD)
        learning = learning * np.where(inner, INNER_SHARE, 1.0)
        return after._with_missing(layer, lacks, known, learning)

    def _with_lag(
        self,
        model: BeadModel,
        asked: np.ndarray,
        growth: np.ndarray,
        expected: np.ndarray,
        known: np.ndarray,
    ) -> BeadHabits:
        """Gauss-Newton step of the lag on the growth that is not expected, inside the beads."""
        use = known & (model.arc > INNER * model.width)
        if np.count_nonzero(use) < MIN_CELLS:
            return self
        step = 0.05
        low, high = (model.growth(asked, (self.lag + s) * model.width)[use] for s in (-step, step))
        slope, rest = (high - low) / (2 * step), (growth - expected)[use]
        slope, rest = slope - slope.mean(), rest - rest.mean()
        scale = ALIKE * max(float(rest.var()), 1e-6)
        news = float(slope @ slope) / scale
        lag = self.lag + float(slope @ rest) / scale / (self.information + news)
        lag = min(max(lag, LAG_LIMITS[0]), LAG_LIMITS[1])
        return replace(self, lag=lag, information=LAG_FORGETTING * self.information + news)

    def _with_missing(
        self, layer: int, lacks: np.ndarray, known: np.ndarray, learning: np.ndarray
    ) -> BeadHabits:
        side, before = layer % 2, self.of(layer, lacks.shape)
        weight = np.maximum(1 / (self.layers[side] + 2), learning)  # knowing nothing: one layer
        missing, layers = list(self.missing), list(self.layers)
        missing[side] = before + weight * np.where(known, lacks - before, 0.0)
        layers[side] += 1
        return replace(self, missing=tuple(missing), layers=tuple(layers))
