"""Bead bias: what the beads of a job do that the nominal model does not. Metal comes late along the travel, and growth
is missing at the same place again and again.

`shortfall` compares growth with what was asked of the same cell; that says nothing true where neighbouring pieces are
asked very different things, as at the ends of beads. Here growth is compared with what `BeadModel` expects.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .. import filters
from ..grids import CELLS_PER_BEAD
from ..types import with_side
from .model import BeadModel

# quarters of a bead width from arc on, and as many before arc off, that all beads are taken to lay alike
END_PIECES = 8
LAG_SIGMA = 0.3  # bead widths, of the lag before any layer
LAG_LIMITS = (-0.5, 0.5)  # bead widths; below zero: the melt trails the torch
LAG_FORGETTING = 0.97  # per layer
NOISE_CORRELATION_CELLS = 4.0  # neighbouring cells whose noise is one
INNER = 1.0  # bead widths from arc on and off, where the lag can be told from humps and craters
INNER_SHARE = 1 / 3  # of the learning rate there, for little comes back; the rest is noise
DRIFT, MAX_DRIFT = 0.15, 0.05  # weight of the newest layer in the surplus; most that is believed
MIN_CELLS = 50
# Layer heights that a place may lack: the most, and what is believed where asking for more moved nothing. Metal that
# is asked for at the end of a bead and arrives elsewhere is missing there for good: asked for again and again, it heaps
# up behind the end.
MAX_MISSING, MIN_MISSING = 1.0, 0.25
RESPONSE, RESPONSE_SIGMA, RESPONSE_SCATTER = (
    0.3,
    0.15,
    0.25,
)  # of growth near ends; prior, and of one layer
RESPONSE_FORGETTING = 0.9  # per layer
# Response at which ends are filled no more than MIN_FILL, and from which on as far as the solver may.
FILL, MIN_FILL = (0.25, 0.75), 0.2
MOVED = 0.02  # RMS of what was expected otherwise than two layers before, from which on a layer tells the response
END_RATE = 0.5  # weight of the newest layer in that: the mean over many beads has little noise
SEEN = 0.3  # share of a cell that must be known


@dataclass(frozen=True)
class BeadBias:
    """What the layers so far have shown, for the layers to come."""

    # Share of the planned height that is missing beside `ends`: maps on the model's grid of even and of odd layers.
    missing: tuple[np.ndarray | None, np.ndarray | None] = (None, None)  # None = never seen
    layers: tuple[int, int] = (0, 0)  # seen of each
    lag: float = 0.0  # of the metal along the travel, bead widths
    information: float = field(default=LAG_SIGMA**-2)  # 1/variance of the lag
    # Share of metal by which layers exceed what the flow factor allowed for. An efficiency that drifts, as in a part
    # that heats up, is always a layer or two ahead of its estimate.
    surplus: float = 0.0
    # (2*END_PIECES + 1,): what all beads miss alike, by `BeadModel.end`; 0 far from the ends.
    ends: np.ndarray = field(default_factory=lambda: np.zeros(2 * END_PIECES + 1))
    # Of growth near the ends on what the model expects there, from layer to layer of one direction; 1 = as it says.
    response: float = RESPONSE
    response_information: float = RESPONSE_SIGMA**-2
    # (2, rows, cols) of even and odd layers: expected and grown of the newest, NaN = unknown
    newest: tuple[np.ndarray | None, np.ndarray | None] = (None, None)

    @property
    def fill(self) -> float:
        """See `BeadDeviation.fill`."""
        none, all_of_it = FILL
        return min(max((self.response - none) / (all_of_it - none), MIN_FILL), 1.0)

    def of(self, layer: int, model: BeadModel) -> np.ndarray:
        """What layer `layer` will lack: what all beads do at their ends, and what was seen at the place."""
        return self.ends[_end(model)] + self._here(layer, model.shape)

    def _here(self, layer: int, shape: tuple[int, int]) -> np.ndarray:
        """Before the direction was ever seen, half of what the other one did."""
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
        height: np.ndarray | float = 1.0,
    ) -> BeadBias:
        """With one more layer, which counts at least `learning`. allowed: efficiency that the flow factor assumed.

        asked (m,): relative growth that the segments should have given; growth (rows, cols) over the planned height;
        seen (rows, cols): share of the cells that is known and away from the edge; height (rows, cols): planned, in any
        unit, of layers that are not equally thick everywhere.
        """
        expected = model.growth(asked, self.lag * model.width)
        known = (seen > SEEN) & (expected > SEEN)
        if np.count_nonzero(known) < MIN_CELLS:
            return self
        ratio = float(np.median(growth[known] / expected[known]))
        after = self._with_lag(model, asked, growth / ratio, expected, known)
        expected = model.growth(asked, after.lag * model.width)
        after = after._with_response(layer, model, expected, growth / ratio, known)
        most = min(max(after.response, MIN_MISSING), 1.0) * MAX_MISSING
        lacks = np.clip(np.where(known, ratio * expected - growth, 0.0), -most, most)
        if allowed is not None:
            news = float(np.clip(ratio / allowed - 1, -MAX_DRIFT, MAX_DRIFT))
            after = replace(after, surplus=self.surplus + DRIFT * (news - self.surplus))
        inner = (model.arc > INNER * model.width) & (filters.depth(known) > INNER * CELLS_PER_BEAD)
        weight = learning * np.where(inner, INNER_SHARE, 1.0)
        after = after._with_ends(layer, model, lacks, known)
        metal = np.where(known, seen * height, 0.0)
        lacks = _without_level(lacks - after.ends[_end(model)], expected, metal)
        return after._with_missing(layer, lacks, known, weight)

    def _with_lag(
        self,
        model: BeadModel,
        asked: np.ndarray,
        growth: np.ndarray,
        expected: np.ndarray,
        known: np.ndarray,
    ) -> BeadBias:
        """Gauss-Newton step of the lag on the growth that is not expected, inside the beads."""
        use = known & (model.arc > INNER * model.width)
        if np.count_nonzero(use) < MIN_CELLS:
            return self
        step = 0.05
        low, high = (model.growth(asked, (self.lag + s) * model.width)[use] for s in (-step, step))
        slope, rest = (high - low) / (2 * step), (growth - expected)[use]
        slope, rest = slope - slope.mean(), rest - rest.mean()
        scale = NOISE_CORRELATION_CELLS * max(float(rest.var()), 1e-6)
        news = float(slope @ slope) / scale
        lag = self.lag + float(slope @ rest) / scale / (self.information + news)
        lag = min(max(lag, LAG_LIMITS[0]), LAG_LIMITS[1])
        return replace(self, lag=lag, information=LAG_FORGETTING * self.information + news)

    def _with_response(
        self,
        layer: int,
        model: BeadModel,
        expected: np.ndarray,
        growth: np.ndarray,
        known: np.ndarray,
    ) -> BeadBias:
        """A scalar Kalman filter on the slope of what grew otherwise than two layers before on what was expected
        otherwise, near arc on and off."""
        side = layer % 2
        both = np.where(known, np.stack([expected, growth]), np.nan)
        after = replace(self, newest=with_side(self.newest, side, both))
        before = self.newest[side]
        if before is None or before.shape != both.shape:
            return after
        x, y = (both - before)[:, model.arc <= INNER * model.width]
        use = np.isfinite(x) & np.isfinite(y)
        if use.sum() < MIN_CELLS or (sxx := float(x[use] @ x[use])) < MOVED**2 * use.sum():
            return after
        slope = float(x[use] @ y[use]) / sxx
        rest = float(((y - slope * x)[use] ** 2).mean())
        noise = NOISE_CORRELATION_CELLS * rest / sxx + RESPONSE_SCATTER**2
        known_before = RESPONSE_FORGETTING * self.response_information
        information = known_before + 1 / noise
        response = (known_before * self.response + slope / noise) / information
        return replace(
            after, response=min(max(response, 0.0), 1.0), response_information=information
        )

    def _with_ends(
        self, layer: int, model: BeadModel, lacks: np.ndarray, known: np.ndarray
    ) -> BeadBias:
        where = _end(model)[known] % len(self.ends)  # negative ones count from the end
        news = (lacks - self._here(layer, lacks.shape))[known]
        count = np.bincount(where, minlength=len(self.ends))
        total = np.bincount(where, news, len(self.ends))
        weight = max(1 / (sum(self.layers) + 1.5), END_RATE)
        change = np.where(count > 0, total / np.maximum(count, 1) - self.ends, 0.0)
        change[0] = 0.0
        return replace(self, ends=self.ends + weight * change)

    def _with_missing(
        self, layer: int, lacks: np.ndarray, known: np.ndarray, learning: np.ndarray
    ) -> BeadBias:
        side, before = layer % 2, self._here(layer, lacks.shape)
        weight = np.maximum(1 / (self.layers[side] + 2), learning)  # knowing nothing: one layer
        missing = before + weight * np.where(known, lacks - before, 0.0)
        return replace(
            self,
            missing=with_side(self.missing, side, missing),
            layers=with_side(self.layers, side, self.layers[side] + 1),
        )


def _without_level(lacks: np.ndarray, expected: np.ndarray, metal: np.ndarray) -> np.ndarray:
    """What is missing by place, without what is missing of all the metal: that is for the efficiency to follow. Left
    in, it would come back two layers later, when the same direction is laid again.

    lacks, expected (rows, cols): shares of the planned height; metal (rows, cols): that was planned, 0 = unknown.
    """
    level = float((metal * lacks).sum()) / float((metal * expected).sum())
    return np.where(metal > 0, lacks - level * expected, 0.0)


def _end(model: BeadModel) -> np.ndarray:
    """(rows, cols) place of the cells in `BeadBias.ends`; 0: far from the ends."""
    return np.where(np.abs(model.end) <= END_PIECES, model.end, 0)
