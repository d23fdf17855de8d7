"""From what former jobs have taught to what a job starts with, and from what it has shown to what it teaches.

`waam_process.learned` says how jobs are merged. The efficiency that is kept is that of the first layer: later ones are
laid on a warmer part, and the estimate follows them by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_process.learned import Learned, Taught

from .estimate import Estimate
from .identification import Identifier, Start


def start_of(learned: Learned | None) -> Start:
    """What a job starts with."""
    if learned is None or not learned.jobs:
        return Start()
    estimate = replace(
        Estimate(),
        efficiency_ratio=learned.efficiency,
        efficiency_sigma=learned.efficiency_sigma,
    )
    return Start(estimate)


def taught_by(job: Identifier) -> Taught | None:
    """What the layers of a job so far have shown; None before the first layer was seen."""
    first = job.seen.get(1)
    if first is None:
        return None
    sigma = float(np.hypot(first.ratio_sigma, job.estimate.layer_noise))
    return Taught(efficiency=first.ratio, efficiency_sigma=sigma, layers=len(job.seen))
