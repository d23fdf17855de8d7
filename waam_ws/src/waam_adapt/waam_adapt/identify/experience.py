"""From what former jobs have taught to what a job starts with, and from what it has shown to what it teaches.

`waam_process.learned` says what is kept and how jobs are merged. The efficiency that is kept is that of the first
layer: later ones are laid on a warmer part, and the estimate follows them by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_process.learned import Learned, Taught

from ..beads.bead_bias import BeadBias
from ..beads.skill import Skill
from .estimate import Estimate
from .identification import Identifier, Start

NOISE_LAYERS = 4  # of a job, from which on it says how its layers scatter


def start_of(learned: Learned | None, network: str) -> Start:
    """What a job starts with. network: hash of the growth network; another one starts untried."""
    if learned is None or not learned.jobs:
        return Start()
    estimate = replace(
        Estimate(),
        efficiency_ratio=learned.efficiency,
        efficiency_sigma=learned.efficiency_sigma,
        layer_noise=learned.layer_noise,
    )
    ends = np.zeros_like(BeadBias().ends)
    half = len(learned.ends) // 2
    ends[1 : half + 1], ends[half + 1 :] = learned.ends[:half], learned.ends[half:]
    beads = replace(BeadBias(), lag=learned.lag, ends=ends)
    skill = Skill()
    if network and network == learned.network:
        skill = replace(skill, weight=learned.network_weight)
    return Start(estimate, beads, skill)


def taught_by(job: Identifier, network: str) -> Taught | None:
    """What the layers of a job so far have shown; None before the first layer was seen."""
    first = job.seen.get(1)
    if first is None:
        return None
    estimate, beads = job.estimate, job.beads
    watched = sum(beads.layers) > 0
    return Taught(
        efficiency=first.ratio,
        efficiency_sigma=float(np.hypot(first.ratio_sigma, estimate.layer_noise)),
        layers=len(job.seen),
        layer_noise=estimate.layer_noise if len(job.seen) >= NOISE_LAYERS else None,
        lag=beads.lag if watched else None,
        ends=tuple(float(v) for v in beads.ends[1:]) if watched else None,
        network_weight=job.skill.weight if job.skill.layers else None,
        network=network if job.skill.layers else '',
    )
