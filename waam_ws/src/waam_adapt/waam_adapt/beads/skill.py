"""Weight of a growth network in a job, by how well it predicted the layers that the job has laid.

Predicted growth and measured growth are compared beside the bead model's answer to the setpoints that were driven, so
the forecast's own effect on the setpoints is in neither of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from waam_process.learned import UNTRIED

from .model import BeadModel

LEAST = 0.3  # of a layer, expected and seen, for a cell to count
MOST = 0.8  # share of the planned height beside the model that is believed
UNTRIED_SIGMA = 0.25  # of the weight `UNTRIED` before any layer was seen
LAYER_SCATTER = 0.25  # of the slope of a single layer about that of its job
FORGETTING = 0.9  # per layer
ALIKE = 4.0  # neighbouring cells whose noise is one
MIN_CELLS = 10.0
MIN_PREDICTED = 0.01  # RMS share of the planned height; smaller forecasts say nothing of the skill


class Beside(NamedTuple):
    """growth (rows, cols): share of the planned height that grew beside what the bead model expected, level taken off;
    weight (rows, cols): share of the cells that is known, 0 where too little is."""

    growth: np.ndarray
    weight: np.ndarray


def beside_model(
    model: BeadModel, asked: np.ndarray, growth: np.ndarray, seen: np.ndarray, lag: float
) -> Beside | None:
    """What a layer grew beside the bead model; None when too little of it was seen.

    asked (m,): relative growth that the segments should have given; growth (rows, cols): over the planned height; seen
    (rows, cols): share of the cells that is known and away from the edge; lag: bead widths.
    """
    expected = model.growth(asked, lag * model.width)
    use = (seen > LEAST) & (expected > LEAST)
    weight = np.where(use, seen, 0.0)
    if weight.sum() < MIN_CELLS:
        return None
    level = float(np.median(growth[use] / expected[use]))
    return Beside(np.where(use, np.clip(growth - level * expected, -MOST, MOST), 0.0), weight)


@dataclass(frozen=True)
class Skill:
    """weight: 0..1, of what the network predicts of the next layer. A scalar Kalman filter on the slopes of what was
    measured on what was predicted."""

    weight: float = UNTRIED
    information: float = UNTRIED_SIGMA**-2  # 1/variance of the weight
    layers: int = 0  # seen

    def learn(self, predicted: np.ndarray, found: Beside) -> Skill:
        """With one more layer. predicted (rows, cols): share of the planned height beside the model, unweighed."""
        w = found.weight / found.weight.sum()
        x, y = (v - float((w * v).sum()) for v in (predicted, found.growth))
        sxx, sxy = float((w * x * x).sum()), float((w * x * y).sum())
        if sxx < MIN_PREDICTED**2:
            return self
        slope = sxy / sxx
        rest = float((w * (y - slope * x) ** 2).sum())
        noise = ALIKE * rest / (float(found.weight.sum()) * sxx) + LAYER_SCATTER**2
        known = FORGETTING * self.information
        information = known + 1 / noise
        weight = (known * self.weight + slope / noise) / information
        return Skill(min(max(weight, 0.0), 1.0), information, self.layers + 1)
