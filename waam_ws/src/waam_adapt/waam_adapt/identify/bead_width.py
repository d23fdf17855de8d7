"""Bead width held by the voltage of the source, from layer to layer: what the beads of a job are wider than expected.

Expected is the width of the material table's default regime, carried to the setpoints of the layer by eq 2.13 of source
000 (`waam_process.materials.Material.width`). The ratio of measured to expected width is identified here; the voltage
that gives the planned width with it is set by the feed-forward, once per layer (docs/interfaces.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

UNKNOWN = 0.10  # relative standard uncertainty of the table's width
DRIFT = 0.012  # by which the ratio changes from layer to layer
SCATTER = 0.015  # of the mean widths of layers laid alike, and of how they are measured
MIN_RATIO, MAX_RATIO = 0.6, 1.6  # ratios beyond this are a fault of the measurement


@dataclass(frozen=True)
class SeenWidth:
    """What the last scan showed. Lengths m; NaN where no bead stood free."""

    width: float = math.nan
    u: float = math.nan  # standard uncertainty of it
    expected: float = math.nan


@dataclass(frozen=True)
class WidthEstimate:
    """Measured over expected width, with its standard uncertainty. `layers`: that showed a width."""

    ratio: float = 1.0
    sigma: float = UNKNOWN
    layers: int = 0

    def after(self, seen: SeenWidth) -> WidthEstimate:
        """With one more layer, by a scalar Kalman filter on the logarithm; what showed no width only grows old.

        How much of a difference is believed is its gain: nearly all of the first one, then less, for layers scatter.
        """
        variance = self.sigma**2 + (DRIFT**2 if self.layers else 0.0)
        ratio = seen.width / seen.expected if seen.expected > 0 else math.nan
        if not (MIN_RATIO <= ratio <= MAX_RATIO and seen.u >= 0 and math.isfinite(seen.u)):
            return replace(self, sigma=min(math.sqrt(variance), UNKNOWN))
        noise = (seen.u / seen.width) ** 2 + SCATTER**2
        gain = variance / (variance + noise)
        step = gain * math.log(ratio / self.ratio)
        return WidthEstimate(
            self.ratio * math.exp(step), math.sqrt((1 - gain) * variance), self.layers + 1
        )


@dataclass
class WidthIdentifier:
    """Follows the widths of one job; asking twice for the same layer does not count its evidence twice."""

    job_id: str = ''
    layer: int = 0
    estimate: WidthEstimate = WidthEstimate()
    _before: WidthEstimate = WidthEstimate()

    def add(self, job_id: str, layer: int, seen: SeenWidth) -> WidthEstimate:
        """What is believed before `layer`, from the scan before it. Another job begins anew."""
        if job_id != self.job_id or layer < self.layer:
            self._before = WidthEstimate()
        elif layer > self.layer:
            self._before = self.estimate
        self.job_id, self.layer = job_id, layer
        self.estimate = self._before.after(seen)
        return self.estimate
