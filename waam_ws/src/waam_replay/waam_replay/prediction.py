"""What a layer would have grown to: its setpoints against what the recorded ones really gave.

Metal per length goes with feed over speed (`waam_process.bead.commanded_growth`); the share of it that arrived in this
layer is known from the scans before and after, and is taken to be the same for other setpoints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from waam_process.bead import commanded_growth

from .corrections import PsiAgain
from .setpoints import FeedAgain


@dataclass(frozen=True)
class Prediction:
    """Surfaces (rows, cols) m after one layer, NaN outside its footprint."""

    layer: int
    target: np.ndarray  # that was wanted
    measured: np.ndarray | None  # by the next scan; None = there is none
    recorded: np.ndarray  # by the recorded setpoints
    again: np.ndarray  # by the setpoints with other parameters
    # share of the commanded metal that the recorded layer kept; 1 without a next scan
    arrived: float

    def rms(self, name: str) -> float:
        """RMS height error in m of 'measured', 'recorded' or 'again' against the target; NaN where unknown."""
        surface = getattr(self, name)
        if surface is None:
            return float('nan')
        error = (surface - self.target)[np.isfinite(surface) & np.isfinite(self.target)]
        return float(np.sqrt(np.mean(error**2))) if error.size else float('nan')

    @property
    def change(self) -> tuple[float, float]:
        """RMS and largest change of the predicted height in m by the other setpoints."""
        d = (self.again - self.recorded)[np.isfinite(self.again) & np.isfinite(self.recorded)]
        if not d.size:
            return 0.0, 0.0
        return float(np.sqrt(np.mean(d**2))), float(np.abs(d).max())


def predict(psi: PsiAgain, feed: FeedAgain, after: np.ndarray | None) -> Prediction:
    """after: (rows, cols) m, the surface that the next scan found."""
    footprint = psi.core.footprint
    planned = np.where(footprint, np.nan_to_num(psi.core.planned), 0.0)
    old, new = (planned * _spread(psi, feed, r) for r in _ratios(feed))
    before = np.where(footprint, psi.core.z, np.nan)
    arrived = 1.0
    if after is not None:
        share = ((after - before) / np.where(old > 0, old, np.nan))[footprint]
        share = share[np.isfinite(share)]
        arrived = float(np.median(share)) if share.size else 1.0
    return Prediction(
        psi.layer,
        np.where(footprint, psi.core.target + planned, np.nan),
        None if after is None else np.where(footprint, after, np.nan),
        before + arrived * old,
        before + arrived * new,
        arrived,
    )


def _ratios(feed: FeedAgain) -> tuple[np.ndarray, np.ndarray]:
    """Commanded over planned height of every depositing segment, recorded and again."""
    d, path, r = feed.deposit, feed.path, feed.result

    def ratio(wire: np.ndarray, base: np.ndarray, speed: np.ndarray) -> np.ndarray:
        height = path.height[d]
        return commanded_growth(height, wire[d], base[d], speed[d], path.speed[d]) / height

    old = feed.recorded
    return (
        ratio(old['wire_feed_speed'], old['wire_feed_base'], old['speed']),
        ratio(r.wire_feed_speed, r.wire_feed_base, r.speed),
    )


def _spread(psi: PsiAgain, feed: FeedAgain, ratios: np.ndarray) -> np.ndarray:
    """(rows, cols): of every cell the ratio of the nearest segment's middle."""
    d, spec = feed.deposit, psi.spec
    if not d.any():
        return np.ones(spec.shape)
    middle = 0.5 * (feed.path.start + feed.path.end)[d, :2]
    x, y = np.meshgrid(spec.x, spec.y)
    _, nearest = cKDTree(middle).query(np.column_stack([x.ravel(), y.ravel()]))
    return ratios[nearest].reshape(spec.shape)
