"""The regression of a layer's level on the figures of its plan (`beads.plan_level`), over the jobs of the laboratory.

Wire and cell differ from job to job, so every job has its own mean: what is fitted is how its layers differ. That the
first layer lies otherwise, on a cold and uneven ground, is fitted beside it and left out of the answer: it differs
between kinds of parts by as much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..beads.plan_level import BIAS, WEIGHTS, figures
from .samples import Sample

SHRINK = 30.0  # layers' worth of belief that a figure, standardised, says nothing
FAR = 0.15  # of the logarithm: how far a layer counts as off that of its job, at most
FOLDS = 8  # jobs are left out in turn to say what the fit is worth


def fit(layers: Sequence[Sample]) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Weights by their names in the file, and how good they are; both empty when fewer than FOLDS jobs have two layers
    of known level.

    level_std, level_left: RMS of the logarithm of the level about the mean of its job without and with the answer, on
    jobs left out of the fit, first layers apart.
    """
    jobs = _by_job(layers)
    if len(jobs) < FOLDS:
        return {}, {}
    left, all_ = [], []
    for fold in range(FOLDS):
        slopes = _slopes([j for i, j in enumerate(jobs) if i % FOLDS != fold])
        for x, y in jobs[fold::FOLDS]:
            later, rest = y[1:], (y - x @ slopes)[1:]
            left.append(rest - rest.mean())
            all_.append(later - later.mean())
    slopes = _slopes(jobs)
    # the first layer of a job is the one that is laid before anything is identified
    bias = -float(np.mean([x[0] @ slopes for x, _ in jobs]))
    weights = {
        WEIGHTS: slopes.astype(np.float32),
        BIAS: np.array([bias], np.float32),
    }
    worth = {
        f'level_{name}': float(np.sqrt(np.mean(np.concatenate(v) ** 2)))
        for name, v in (('std', all_), ('left', left))
    }
    return weights, worth


def _by_job(layers: Sequence[Sample]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Figures (layers, len(FIGURES)) and logarithm of the level (layers,) of every job with two or more."""
    found: dict[int, list[tuple[np.ndarray, float]]] = {}
    for s in layers:
        if math.isfinite(s.level) and s.level > 0:
            found.setdefault(s.seed, []).append((figures(s.x), math.log(s.level)))
    jobs = [job for job in found.values() if len(job) > 1]
    return [(np.array([f for f, _ in job]), np.array([v for _, v in job])) for job in jobs]


def _slopes(jobs: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(len(FIGURES),) ridge regression on what differs within jobs; a level that is far off counts as `FAR`."""
    first = [np.eye(len(x), 1) for x, _ in jobs]
    known = [np.hstack([x, f]) for (x, _), f in zip(jobs, first, strict=True)]
    x = np.concatenate([k - k.mean(axis=0) for k in known])
    y = np.concatenate([np.clip(y - y.mean(), -FAR, FAR) for _, y in jobs])
    scale = x.std(axis=0) + 1e-9
    x = x / scale
    found: np.ndarray = np.linalg.solve(x.T @ x + SHRINK * np.eye(x.shape[1]), x.T @ y) / scale
    return found[:-1]
