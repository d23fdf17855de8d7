"""One JSON object per line: name, value, unit, baseline, baseline_value, ratio; preset of the simulated cells."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np


def emit(
    name: str,
    value: float,
    unit: str,
    baseline: str,
    baseline_value: float | None,
    preset: str = '',
) -> None:
    """ratio = value / baseline_value (None when there is nothing to divide by). preset: '' = no field."""
    ratio = value / baseline_value if baseline_value else None
    print(
        json.dumps(
            {
                'name': name,
                'value': round(value, 6),
                'unit': unit,
                'baseline': baseline,
                'baseline_value': baseline_value,
                'ratio': None if ratio is None else round(ratio, 4),
                **({'preset': preset} if preset else {}),
            }
        ),
        flush=True,
    )


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean over the seeds and its 95 % bootstrap interval (2000 resamplings, fixed seed)."""
    v = np.asarray(values, float)
    picks = np.random.default_rng(0).integers(0, len(v), (2000, len(v)))
    many = v[picks].mean(axis=1)
    return float(v.mean()), float(np.quantile(many, 0.025)), float(np.quantile(many, 0.975))
