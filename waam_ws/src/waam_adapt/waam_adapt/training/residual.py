"""The regression on what the closed loop leaves (`beads.residual`), over layers that a growth network has laid.

Its answer changes what the loop leaves, so it is fitted in rounds: every round lays jobs with the weights of the one
before, and what these still leave is added to them, by SHARE of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..beads.residual import FIGURES, WEIGHTS
from ..laws import net_file
from ..laws.net import Network
from .growth_card import card_text
from .samples import Sample

SHARE = 0.8
SHRINK = 3e-3  # ridge, of the scale of every figure
FOLDS = 8  # jobs are left out in turn to say what the fit is worth


def fit(layers: Sequence[Sample]) -> tuple[np.ndarray, dict[str, Any]]:
    """(FIGURES,) weights, and what they are worth: layers, jobs, seeds, and `explained`, the share of the variance that
    they tell of layers of jobs left out. ValueError when fewer than FOLDS jobs were laid with a network."""
    found: dict[int, list[np.ndarray]] = {}
    for s in layers:
        if s.moments is not None:
            found.setdefault(s.seed, []).append(s.moments)
    jobs = [np.sum(found[seed], axis=0) for seed in sorted(found)]
    if len(jobs) < FOLDS:
        text = f'{len(jobs)} jobs that were laid with a network, {FOLDS} are needed'
        raise ValueError(f'{text}: make some with python3 -m waam_lab.growth_data --law unet')
    total = np.sum(jobs, axis=0)
    left = sum(
        _left(out, _solved(total - out))
        for out in (np.sum(jobs[k::FOLDS], axis=0) for k in range(FOLDS))
    )
    seeds = sorted(found)
    worth = {
        'layers': sum(len(v) for v in found.values()),
        'jobs': len(jobs),
        'seeds': [seeds[0], seeds[-1]],
        'explained': float(1 - left / total[-1, -1]),
    }
    return _solved(total), worth


def add(network: Network, layers: Sequence[Sample], path: Path) -> tuple[str, float]:
    """Writes the network with SHARE of what its layers teach added to its regression, and the card beside it. Returns
    the hash, and the share of the variance that is told of layers left out. ValueError as `fit`."""
    weights, worth = fit(layers)
    before = network.weights.get(WEIGHTS, np.zeros(FIGURES, np.float32))
    told = {WEIGHTS: (before + SHARE * weights).astype(np.float32)}
    card = {**network.card, 'residual': [*network.card.get('residual', []), worth]}
    code = net_file.save(path, {**network.weights, **told}, card)
    path.with_suffix('.md').write_text(card_text(card, code))
    return code, float(worth['explained'])


def _solved(moments: np.ndarray) -> np.ndarray:
    """(FIGURES,) ridge regression from sums of `beads.residual.moments`."""
    square, product = moments[:-1, :-1], moments[:-1, -1]
    scale = np.sqrt(np.maximum(np.diag(square), 1e-12))
    ridge = square / np.outer(scale, scale) + SHRINK * np.eye(len(scale))
    found: np.ndarray = np.linalg.solve(ridge, product / scale) / scale
    return found


def _left(moments: np.ndarray, weights: np.ndarray) -> float:
    """Variance that the weights do not tell."""
    square, product = moments[:-1, :-1], moments[:-1, -1]
    return float(moments[-1, -1] - 2 * weights @ product + weights @ square @ weights)
