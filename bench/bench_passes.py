"""Scan passes over what a layer has changed (`scan_changed_only`), against passes over the whole part: jobs of the
demo's jaw in the laboratory.

passes.scan_time_ratio: time in state SCANNING, ways to the scans included; passes.job_time_ratio: the whole job;
passes.rms_ratio: RMS at the end. All paired over seeds; 95 % intervals on stderr.

Settings were chosen on seeds 101 to 104. `WAAM_BENCH_SEEDS=1,2` chooses others, `WAAM_BENCH_WORKERS` the number of
processes (2).
"""

from __future__ import annotations

import sys

import numpy as np
from bench_shape import jaw_jobs
from lib.emit import emit
from lib.seeds import seeds

SEEDS = tuple(range(1, 21))
CHANGED_ONLY = {'job_sequencer': {'scan_changed_only': True}}
OF = {
    'passes.scan_time_ratio': 'scan_time',
    'passes.job_time_ratio': 'time',
    'passes.rms_ratio': 'rms',
}


def told(name: str, ratios: np.ndarray) -> float:
    """The mean ratio; its 95 % interval goes to stderr."""
    from scipy import stats

    n = len(ratios)
    half = stats.t.ppf(0.975, n - 1) * ratios.std(ddof=1) / np.sqrt(n) if n > 1 else np.nan
    print(f'{name}: {ratios.mean():.4f} +- {half:.4f} ({n} seeds)', file=sys.stderr)
    return float(ratios.mean())


def changed_only() -> None:
    """All of it, of the same jobs."""
    only, whole = (jaw_jobs(seeds(SEEDS), overrides=o) for o in (CHANGED_ONLY, {}))
    for figure, name in OF.items():
        ratios = [getattr(a, name) / getattr(b, name) for a, b in zip(only, whole, strict=True)]
        emit(figure, told(figure, np.array(ratios)), '', 'passes over the whole part', 1.0)


FIGURES = dict.fromkeys(OF, changed_only)
