"""What layers miss at the same place again and again, learned so that the next layer need not wait for it.

Humps where beads turn or arcs strike and hollows where they end come back in every layer; a law that sees only the
surface is always one layer late for them. Zig-zag layers run forth and back, so what layer n misses is expected of
layer n + 2, not of n + 1: one map per direction of travel (iterative learning control with a period of two).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from ..types import with_side

MAX_SHORTFALL = 0.5  # share; more is a fault


@dataclass(frozen=True)
class Shortfall:
    """Share of the expected growth that is missing: maps (rows, cols) of even and of odd layers; None = not learned.

    Mean over the layers so far, with at least the weight `learning` for the newest one.
    """

    maps: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    layers: tuple[int, int] = (0, 0)

    def share(self, layer: int) -> np.ndarray | None:
        """What is expected of layer `layer`; before its direction was ever seen, half of what the other one missed."""
        own, other = self.maps[layer % 2], self.maps[1 - layer % 2]
        if own is None and other is not None:
            return 0.5 * other
        return own

    def learn(self, layer: int, missing: np.ndarray, learning: float, smooth: float) -> Shortfall:
        """With one more layer: missing share (rows, cols), NaN = unknown (keeps what it had). smooth: cells."""
        side = layer % 2
        before = self.share(layer)
        before = np.zeros(missing.shape) if before is None else before
        if before.shape != missing.shape:
            return self
        news = np.clip(missing, -MAX_SHORTFALL, MAX_SHORTFALL) - before
        weight = max(1 / (self.layers[side] + 2), learning)  # the prior counts as one layer
        share = before + weight * _smooth(news, smooth)
        layers = with_side(self.layers, side, self.layers[side] + 1)
        return Shortfall(with_side(self.maps, side, share), layers)


def _smooth(values: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian mean of the known cells (sigma in cells); 0 where a cell itself is unknown."""
    known = np.isfinite(values)
    weight = gaussian_filter(known.astype(float), sigma)
    total = gaussian_filter(np.where(known, values, 0.0), sigma)
    return np.where(known, total / np.maximum(weight, 1e-9), 0.0)
