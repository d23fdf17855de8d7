"""Figures of many jobs as bands: mean, best, worst, and the interval of the next job. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from .job import LabMaps, LabResult

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Band:
    """One figure over the seeds."""

    mean: float
    # where the next job lies with 95 %, from here (Student's t; NaN for fewer than three jobs)
    low: float
    high: float  # to here
    best: float
    worst: float
    worst_seed: int  # of the job with the worst value


@dataclass(frozen=True)
class Share:
    """Jobs in tolerance."""

    count: int  # jobs in tolerance,
    of: int  # of so many
    low: float  # 95 % interval of the share (Clopper and Pearson 1934)
    high: float

    @property
    def value(self) -> float:
        """0 to 1; NaN without jobs."""
        return self.count / self.of if self.of else math.nan


def band(results: Sequence[LabResult], name: str, more_is_better: bool = False) -> Band | None:
    """Over the jobs that have the figure; None when there is none."""
    known = [(getattr(r, name), r.seed) for r in results if math.isfinite(getattr(r, name))]
    if not known:
        return None
    values = np.array([v for v, _ in known])
    worst = (min if more_is_better else max)(known)
    low, high = next_value(values)
    best = float(values.max() if more_is_better else values.min())
    return Band(float(values.mean()), low, high, best, worst[0], worst[1])


def next_value(values: np.ndarray) -> tuple[float, float]:
    """Prediction interval of one more value: mean +- t * s * sqrt(1 + 1/n)."""
    n = len(values)
    if n < 3:
        return math.nan, math.nan
    reach = stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1) * values.std(ddof=1) * math.sqrt(1 + 1 / n)
    return float(values.mean() - reach), float(values.mean() + reach)


def in_tolerance(results: Sequence[LabResult]) -> Share:
    """Failed jobs count against it."""
    n, k = len(results), sum(r.in_tolerance for r in results)
    tail = (1 - CONFIDENCE) / 2
    low = float(stats.beta.ppf(tail, k, n - k + 1)) if k else 0.0
    high = float(stats.beta.ppf(1 - tail, k + 1, n - k)) if k < n else 1.0
    return Share(k, n, low, high)


@dataclass(frozen=True)
class Maps:
    """Maps over the seeds, (rows, cols). NaN where no job has judged or seen the cell."""

    first: LabMaps  # of the first job
    mean: np.ndarray  # m, mean error
    worst: np.ndarray  # m, the largest error with its sign
    within: np.ndarray  # share of the jobs in which the cell is in tolerance
    region: np.ndarray  # bool, what most jobs laid
    interior: np.ndarray  # bool, what most jobs judged


def maps(results: Sequence[LabResult], tolerance: float) -> Maps | None:
    """None without a job that came to its end. tolerance: m"""
    found = [r.maps for r in results if r.maps is not None]
    if not found:
        return None
    region = np.mean([m.region for m in found], axis=0) >= 0.5
    interior = np.mean([m.interior for m in found], axis=0) >= 0.5
    errors = np.array([np.where(m.region, m.error, np.nan) for m in found], float)
    seen = np.isfinite(errors)
    count = seen.sum(axis=0)
    known = region & (count > 0)
    filled = np.where(seen, errors, 0.0)
    largest = np.abs(filled).argmax(axis=0)
    worst = np.take_along_axis(filled, largest[None], axis=0)[0]
    within = (seen & (np.abs(filled) <= tolerance)).sum(axis=0) / np.maximum(count, 1)
    mean = filled.sum(axis=0) / np.maximum(count, 1)
    mean, worst, within = (np.where(known, a, np.nan) for a in (mean, worst, within))
    return Maps(found[0], mean, worst, within, region, interior)


def judged_errors(results: Sequence[LabResult]) -> np.ndarray:
    """(n,) m: errors of all judged cells of all jobs."""
    errors = [r.maps.error[r.maps.interior] for r in results if r.maps is not None]
    joined = np.concatenate(errors) if errors else np.empty(0)
    return joined[np.isfinite(joined)]


def level_bands(results: Sequence[LabResult]) -> list[tuple[float, float, float]]:
    """m: mean, lowest and highest mean error after each layer that at least one job has laid."""
    rows = []
    for layer in range(max((len(r.layer_means) for r in results), default=0)):
        values = [r.layer_means[layer] for r in results if len(r.layer_means) > layer]
        known = [v for v in values if math.isfinite(v)]
        if known:
            rows.append((float(np.mean(known)), min(known), max(known)))
    return rows
