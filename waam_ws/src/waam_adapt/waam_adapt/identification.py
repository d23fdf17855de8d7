"""What the layers teach about the process: measured growth against the growth that the material
table expects.

Both maps are averaged over square blocks one bead wide, so the waviness of the beads and the noise
of the scanner drop out and the blocks are about independent. A scalar Kalman filter follows the
efficiency ratio from layer to layer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from . import filters

LOW, HIGH = 0.7, 1.3  # efficiency ratios beyond this are a fault, not a property of the wire
MIN_BLOCKS = 4
MAX_SHORTFALL = 0.5  # share; more is a fault and no habit
MIN_GROWTH = 0.2e-3  # m; thinner layers say nothing about the ratio


@dataclass(frozen=True)
class LayerEvidence:
    """One layer: ratio of growths and its standard uncertainty, slope of growth on command with its
    own, spread in m.
    """

    ratio: float
    ratio_sigma: float
    slope: float
    slope_sigma: float
    spread: float
    commanded: float
    blocks: int


@dataclass(frozen=True)
class Estimate:
    """What is believed about the process. Ratio and slope start at 1 with the uncertainty of a wire
    that was never used.
    """

    efficiency_ratio: float = 1.0
    efficiency_sigma: float = 0.15
    slope: float = 1.0
    slope_sigma: float = 0.3
    spread: float = math.nan
    innovation: float = math.nan
    drift_alarm: bool = False
    updates: int = 0

    @property
    def flow_factor(self) -> float:
        """Multiplies the wire feed so that the table's metal arrives: 1/efficiency_ratio, inside
        1/1.3 .. 1/0.7.
        """
        return 1.0 / min(max(self.efficiency_ratio, LOW), HIGH)

    @property
    def height_exponent(self) -> float:
        """d ln(height)/d ln(speed) on overlapped beads: -slope, because the command varies as
        1/speed (mass balance).
        """
        return -self.slope


def block_means(
    values: np.ndarray, known: np.ndarray, size: int, share: float = 0.6
) -> tuple[np.ndarray, np.ndarray]:
    """Means over size x size blocks and a mask of the blocks of which at least `share` of the cells
    are known.
    """
    rows, cols = (n // size * size for n in values.shape)
    shape = (rows // size, size, cols // size, size)
    n = known[:rows, :cols].reshape(shape).sum(axis=(1, 3))
    total = np.where(known, values, 0.0)[:rows, :cols].reshape(shape).sum(axis=(1, 3))
    return total / np.maximum(n, 1), n >= share * size * size


@dataclass(frozen=True)
class Layer:
    """One layer as it was laid. Maps (rows, cols) in m.

    before, after: surfaces, NaN = unknown. commanded: growth that the table expects of the final feed and speed
    (`waam_process.bead.commanded_growth`), 0 or NaN outside the layer.
    """

    before: np.ndarray
    after: np.ndarray
    commanded: np.ndarray
    resolution: float
    bead_width: float


def layer_evidence(layer: Layer) -> LayerEvidence | None:
    """Evidence of one layer; None when too little of its interior (half a bead at the edge is left out) is known."""
    commanded, resolution, bead_width = layer.commanded, layer.resolution, layer.bead_width
    footprint = np.nan_to_num(commanded) > MIN_GROWTH
    interior = filters.depth(footprint) * resolution > 0.5 * bead_width
    growth = layer.after - layer.before
    known = interior & np.isfinite(growth)
    size = max(1, round(bead_width / resolution))
    g, enough = block_means(growth, known, size)
    c, _ = block_means(commanded, known, size)
    g, c = g[enough], c[enough]
    if g.size < MIN_BLOCKS:
        return None
    ratio = float(np.median(g / c))
    residual = g - ratio * c
    spread = float(1.4826 * np.median(np.abs(residual - np.median(residual))))
    ratio_sigma = 1.2533 * max(spread / float(c.mean()), 5e-3) / math.sqrt(g.size)
    return LayerEvidence(ratio, ratio_sigma, *_slope(g, c, ratio), spread, float(c.mean()), g.size)


def _slope(g: np.ndarray, c: np.ndarray, ratio: float) -> tuple[float, float]:
    """Slope of relative growth on relative command over the blocks and its uncertainty, inf without
    excitation (< 2 %).
    """
    x, y = c / c.mean() - 1, g / (ratio * c.mean()) - 1
    sxx = float(((x - x.mean()) ** 2).sum())
    if g.size < 8 or math.sqrt(sxx / g.size) < 0.02:
        return 1.0, math.inf
    slope = float(((x - x.mean()) * (y - y.mean())).sum() / sxx)
    scatter = y - y.mean() - slope * (x - x.mean())
    return slope, math.sqrt(float((scatter**2).sum()) / (g.size - 2) / sxx)


def update(
    estimate: Estimate, evidence: LayerEvidence, forgetting: float, alarm_sigmas: float = 3.0
) -> Estimate:
    """The next estimate. forgetting 0..1 (exclusive): how fast old layers lose weight; 0.5
    remembers about two layers.

    drift_alarm: the layer lies further from the prediction than `alarm_sigmas` of its uncertainty
    and 5 %, once the estimate has settled (two layers), or the ratio leaves 0.7 .. 1.3. An evident
    outlier moves the estimate no further than that distance.
    """
    prior = estimate.efficiency_sigma**2 / (forgetting if estimate.updates else 1.0)
    noise = evidence.ratio_sigma**2
    difference = evidence.ratio - estimate.efficiency_ratio
    limit = max(alarm_sigmas * math.sqrt(prior + noise), 0.05)
    gain = prior / (prior + noise)
    settled = estimate.updates >= 2
    step = max(-limit, min(limit, difference)) if settled else difference
    slope, slope_sigma = _combine(
        estimate.slope, estimate.slope_sigma, evidence.slope, evidence.slope_sigma
    )
    return replace(
        estimate,
        efficiency_ratio=min(max(estimate.efficiency_ratio + gain * step, LOW), HIGH),
        efficiency_sigma=max(math.sqrt((1 - gain) * prior), 2e-3),
        slope=slope,
        slope_sigma=slope_sigma,
        spread=evidence.spread,
        innovation=difference * evidence.commanded,
        drift_alarm=not LOW <= evidence.ratio <= HIGH or (settled and abs(difference) > limit),
        updates=estimate.updates + 1,
    )


def _combine(a: float, sigma_a: float, b: float, sigma_b: float) -> tuple[float, float]:
    """Inverse-variance mean of two independent estimates."""
    if math.isinf(sigma_b):
        return a, sigma_a
    wa, wb = sigma_a**-2, max(sigma_b, 0.02) ** -2
    return (a * wa + b * wb) / (wa + wb), (wa + wb) ** -0.5


@dataclass(frozen=True)
class Shortfall:
    """Share of the commanded growth that layers miss at the same place, (rows, cols); None = nothing learned yet.

    Humps where beads turn and hollows where they end come back in every layer; a law that sees only the surface is
    always one layer late for them. Mean over the layers so far, with at least the weight `learning` for the newest one.
    """

    share: np.ndarray | None = None
    layers: int = 0

    def learn(self, layer: Layer, ratio: float, learning: float) -> Shortfall:
        """With one more layer, whose efficiency was `ratio`. Cells that are not known keep what they had."""
        enough = np.nan_to_num(layer.commanded) > MIN_GROWTH
        expected = np.where(enough, ratio * layer.commanded, np.nan)
        missing = np.clip(
            1 - (layer.after - layer.before) / expected, -MAX_SHORTFALL, MAX_SHORTFALL
        )
        share = np.zeros_like(layer.before) if self.share is None else self.share
        weight = max(1 / (self.layers + 2), learning)  # the prior, nothing, counts as one layer
        return Shortfall(share + weight * np.nan_to_num(missing - share), self.layers + 1)


@dataclass
class Identifier:
    """Keeps what one job has taught; asking twice for the same layer does not count its evidence twice.

    forgetting: see `update`; learning 0..1: of the shortfall, 0 = never.
    """

    forgetting: float = 0.5
    learning: float = 0.3
    job_id: str = ''
    layer: int = 0
    estimate: Estimate = Estimate()
    shortfall: Shortfall = Shortfall()
    _before: tuple[Estimate, Shortfall] = (Estimate(), Shortfall())

    def start(self, job_id: str, layer: int) -> None:
        """Call before every layer: forgets another job's process, repeats a layer from where it began."""
        if job_id != self.job_id or layer < self.layer:
            self._before = Estimate(), Shortfall()
        elif layer > self.layer:
            self._before = self.estimate, self.shortfall
        self.job_id, self.layer = job_id, layer
        self.estimate, self.shortfall = self._before

    def add(self, layer: Layer) -> None:
        """Learns from the layer that was laid last, if enough of it can be seen."""
        evidence = layer_evidence(layer)
        if evidence is None:
            return
        self.estimate = update(self.estimate, evidence, self.forgetting)
        if self.learning > 0:
            self.shortfall = self.shortfall.learn(layer, evidence.ratio, self.learning)
