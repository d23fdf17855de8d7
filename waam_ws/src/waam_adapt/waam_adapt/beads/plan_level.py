"""Level of a layer from the geometry of its plan: how much of its metal arrives beside other layers of the same job.

Narrow bands lose metal over their rim, thin layers less of it than thick ones. A regression on a few figures of the
layer tells it; how much arrives on average is a matter of wire and cell, and identified. The temperature is none of the
figures: nearly all that it says in the data is that a layer is not the first one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .plan_geometry import NAMES

FIGURES = (
    'thickness', 'area', 'rim', 'taper', 'taper at the rim', 'density', 'neighbours', 'arcs',
)  # fmt: skip
RIM = 0.26  # of the channel 'edge': half a bead from the edge
# of the logarithm: beyond what the layers of one job differ by, the regression is a guess
MOST = 0.05
WEIGHTS, BIAS = 'level.weight', 'level.bias'  # names in the file of a growth network


def figures(x: np.ndarray) -> np.ndarray:
    """Figures (len(FIGURES),) of one input of the growth network (channels, rows, cols), weighed by its footprint,
    which must not be empty."""

    def channel(name: str) -> np.ndarray:
        return x[NAMES.index(name)].astype(float)

    footprint = channel('footprint')
    weight = footprint / footprint.sum()

    def mean(values: np.ndarray) -> float:
        return float((values * weight).sum())

    rim, taper = (channel('edge') < RIM).astype(float), channel('taper')
    return np.array([
        float(x[NAMES.index('thickness')].flat[0]), np.log(footprint.sum()), mean(rim),
        mean(taper**2) ** 0.5, mean(taper * rim), mean(channel('density') ** 2) ** 0.5,
        mean(channel('before') + channel('after')), mean(channel('arc on') + channel('arc off')),
    ])  # fmt: skip


def level(x: np.ndarray, weights: Mapping[str, np.ndarray]) -> float:
    """Logarithm of the efficiency ratio beside that of a job's other layers; 0 from weights without a level."""
    if WEIGHTS not in weights:
        return 0.0
    told = float(figures(x) @ weights[WEIGHTS].astype(float) + weights[BIAS][0])
    return min(max(told, -MOST), MOST)
