"""Level of a layer from the geometry of its plan: how much of its metal arrives beside other layers of the same job.

Narrow bands lose metal over their rim, thin layers less than thick ones, warm ones and short beads more. A regression
on a few figures of the layer tells it; how much arrives on average is a matter of wire and cell, and identified.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .plan_geometry import NAMES

FIGURES = (
    'thickness', 'thickness squared', 'temperature', 'area', 'inside', 'rim', 'taper', 'taper at the rim', 'density',
    'turn', 'neighbours', 'arcs', 'thickness x inside', 'thickness x rim', 'thickness x arcs',
)  # fmt: skip
RIM = 0.26  # of the channel 'edge': half a bead from the edge
MOST = 0.15  # of the logarithm: no geometry changes the level by more
WEIGHTS, BIAS = 'level.weight', 'level.bias'  # names in the file of a growth network


def figures(x: np.ndarray) -> np.ndarray:
    """Figures (len(FIGURES),) of one input of the growth network (channels, rows, cols), weighed by its footprint,
    which must not be empty."""
    channel = dict(zip(NAMES, x.astype(float), strict=True))
    footprint = channel['footprint']
    weight = footprint / footprint.sum()

    def mean(values: np.ndarray) -> float:
        return float((values * weight).sum())

    thickness = float(channel['thickness'].flat[0])
    edge = (channel['edge'] < RIM).astype(float)
    inside, rim, arcs = (
        mean(v) for v in (channel['inside'], edge, channel['arc on'] + channel['arc off'])
    )
    taper, density, turn = (mean(channel[n] ** 2) ** 0.5 for n in ('taper', 'density', 'turn'))
    return np.array([
        thickness, thickness**2, float(channel['temperature'].flat[0]), np.log(footprint.sum()), inside, rim, taper,
        mean(channel['taper'] * edge), density, turn, mean(channel['before'] + channel['after']), arcs,
        thickness * inside, thickness * rim, thickness * arcs,
    ])  # fmt: skip


def level(x: np.ndarray, weights: Mapping[str, np.ndarray]) -> float:
    """Logarithm of the efficiency ratio beside that of a job's other layers; 0 from weights without a level."""
    if WEIGHTS not in weights:
        return 0.0
    told = float(figures(x) @ weights[WEIGHTS].astype(float) + weights[BIAS][0])
    return min(max(told, -MOST), MOST)
