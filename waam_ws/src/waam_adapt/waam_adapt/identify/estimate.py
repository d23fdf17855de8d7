"""What is believed about the process, and how one layer changes it: a scalar Kalman filter for the efficiency ratio,
another one for the exponent of height on metal. Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..beads.model import BeadModel
from .evidence import LayerEvidence

# Relative, of a whole layer, before any is known: what one layer is off all over is mostly gone in the next.
LAYER_NOISE = 0.02
NOISE_LAYERS = 4  # layers that this first belief in the noise counts for
# of the ratio, by one layer once it has settled: wire and heat drift, they do not jump
MAX_STEP = 0.04
MIN_RATIO, MAX_RATIO = (
    0.7,
    1.3,
)  # efficiency ratios beyond this are a fault, not a property of the wire
# per layer: the exponent is a property of geometry and wire, not of one layer
SLOPE_FORGETTING = 0.95
MIN_SLOPE, MAX_SLOPE = 0.2, 1.3  # of growth on metal; beyond this the scan is wrong


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
    # standard deviation of a layer's ratio about the process, identified
    layer_noise: float = LAYER_NOISE
    # 0..1, of the growth network in the next layer (`forecast_weight`); NaN: the law has none or predicted no layer
    network_weight: float = math.nan

    def flow_factor(self, slope: float | None = None) -> float:
        """Multiplies the wire feed so that the planned height arrives: efficiency_ratio^(-1/slope), bounded. slope: of
        growth on metal; None = as estimated, 1 at most."""
        ratio = min(max(self.efficiency_ratio, MIN_RATIO), MAX_RATIO)
        slope = min(self.slope if slope is None else slope, 1.0)
        return min(max(ratio ** (-1 / slope), 1 / MAX_RATIO), 1 / MIN_RATIO)

    def slope_on(self, model: BeadModel | None, caution: float = 0.0) -> float:
        """Of growth on metal: overlapped beads keep all of it, a single one gets wider as well. caution: added to what
        was estimated where nothing says that the beads overlap."""
        if model is not None and model.overlapped:
            return 1.0
        return min(1.0, self.slope + caution)

    @property
    def height_exponent(self) -> float:
        """d ln(height)/d ln(speed): -slope, because the command varies as 1/speed (mass balance)."""
        return -self.slope


def update(
    estimate: Estimate, evidence: LayerEvidence, forgetting: float, alarm_sigmas: float = 3.0
) -> Estimate:
    """The next estimate. forgetting 0..1 (exclusive): how fast old layers lose weight; 0.5
    remembers about two layers.

    How much a layer scatters about the process is identified from the innovations: what they exceed the uncertainty of
    estimate and evidence by is noise of the layers (Mehra 1970, IEEE Trans. Autom. Control 15(2), 175-184).

    drift_alarm: the layer lies further from the prediction than `alarm_sigmas` of its uncertainty
    and 5 %, once the estimate has settled (two layers), or the ratio leaves 0.7 .. 1.3. An evident
    outlier counts as that distance, and no layer moves a settled estimate by more than MAX_STEP.
    """
    prior = estimate.efficiency_sigma**2 / (forgetting if estimate.updates else 1.0)
    noise = evidence.ratio_sigma**2 + estimate.layer_noise**2
    difference = evidence.ratio - estimate.efficiency_ratio
    limit = max(alarm_sigmas * math.sqrt(prior + noise), 0.05)
    gain = prior / (prior + noise)
    settled = estimate.updates >= 2
    step = max(-limit, min(limit, difference)) if settled else difference
    moved = max(-MAX_STEP, min(MAX_STEP, gain * step)) if settled else gain * step
    return replace(
        estimate,
        efficiency_ratio=min(max(estimate.efficiency_ratio + moved, MIN_RATIO), MAX_RATIO),
        efficiency_sigma=max(math.sqrt((1 - gain) * prior), 2e-3),
        spread=evidence.spread,
        innovation=difference * evidence.commanded,
        drift_alarm=not MIN_RATIO <= evidence.ratio <= MAX_RATIO
        or (settled and abs(difference) > limit),
        updates=estimate.updates + 1,
        layer_noise=_layer_noise(estimate, limit, difference, prior + evidence.ratio_sigma**2),
    )


def _layer_noise(estimate: Estimate, limit: float, difference: float, known: float) -> float:
    """The layer noise with one more innovation, `difference`, no larger than `limit`. known: variance that estimate and
    evidence account for. The first layers say what the wire is, not how it scatters."""
    if estimate.updates < 2:
        return estimate.layer_noise
    seen = max(min(abs(difference), limit) ** 2 - known, 0.0)
    count = NOISE_LAYERS + min(estimate.updates - 2, 2 * NOISE_LAYERS)
    return math.sqrt((count * estimate.layer_noise**2 + seen) / (count + 1))


def update_slope(
    estimate: Estimate, slope: float, sigma: float, forgetting: float = SLOPE_FORGETTING
) -> Estimate:
    """With the slope of one more pair of layers, inside `MIN_SLOPE` .. `MAX_SLOPE`; sigma inf changes nothing.

    A slope further than three sigmas from the estimate counts as three sigmas: one odd layer does not turn it round.
    """
    if not math.isfinite(sigma):
        return estimate
    prior, noise = estimate.slope_sigma**2 / forgetting, max(sigma, 0.03) ** 2
    limit = 3 * math.sqrt(prior + noise)
    gain = prior / (prior + noise)
    step = max(-limit, min(limit, slope - estimate.slope))
    return replace(
        estimate,
        slope=min(max(estimate.slope + gain * step, MIN_SLOPE), MAX_SLOPE),
        slope_sigma=max(math.sqrt((1 - gain) * prior), 0.01),
    )
