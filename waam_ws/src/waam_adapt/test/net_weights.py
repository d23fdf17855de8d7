"""Weights for the tests: a network of the right make that was never trained."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waam_adapt.beads import features, plan_geometry
from waam_adapt.laws import net, net_file

WIDTHS = (4, 8, 8)


def random_weights(
    seed: int = 0, head: float = 0.1, channels: int = features.CHANNELS
) -> dict[str, np.ndarray]:
    """head: scale of the last layer; 0 = predicts nothing."""
    rng = np.random.default_rng(seed)
    a, b, c = WIDTHS
    n = channels
    sizes = ((n, a), (a, a), (a, b), (b, b), (b, c), (c, c), (c + b, b), (b, b), (b + a, a), (a, a))
    out = {}
    for name, (i, o) in zip(net.CONVS, sizes, strict=False):
        out[f'{name}.weight'] = rng.normal(0, (2 / (9 * i)) ** 0.5, (o, i, 3, 3))
        out[f'{name}.bias'] = rng.normal(0, 0.05, o)
    for name, scale, bias in (('head', head, 0.0), ('doubt', 0.0, -3.0)):
        out[f'{name}.weight'] = scale * rng.normal(0, 1, (1, a, 1, 1))
        out[f'{name}.bias'] = np.full(1, bias)
    out['skip.weight'] = np.zeros((1, n, 1, 1))
    return {k: np.asarray(v, np.float32) for k, v in out.items()}


def card(low: float = -1e9, high: float = 1e9) -> dict:
    return {
        'seen': {name: [low, high] for name in plan_geometry.SUMMARIES},
        'weights': {'shape': 1.0, 'level': 1.0},
    }


def model(path: Path, seed: int = 0, head: float = 0.1, **changes) -> Path:
    """Writes a model file; changes: arrays put in place of its own."""
    net_file.save(path, random_weights(seed, head) | changes, card())
    return path
