"""The process control: a chosen value held by the feed override, in whole jobs on the simulated cell.

The cell's contact tip and wire wander (arc_tip_wander 1.2 mm in 4 s, arc_feed_wander 4 % in 6 s: the current of a job
scatters as that of a recorded one, see waam_sim/README.md). One layer of a block of 60 x 40 mm, open loop, seeds 1-20.

process.variance_ratio: variance of the true arc current, of means over 0.5 s (in which the pool travels its own length)
in straight steady travel from 1.5 s after each strike on. Mean over the seeds. Baseline: constant feed, same seeds.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from bench_shape import workers
from lib.preset import emit_on_cell as emit
from lib.preset import preset
from lib.seeds import seeds

SEEDS = seeds(tuple(range(1, 21)))
WANDERS = {'arc_tip_wander': 1.2e-3, 'arc_feed_wander': 0.04}


def in_laboratory(value: str) -> list:
    """Results with this value held; 'none' = constant feed."""
    from waam_lab import parts, run_many

    overrides = {'cell': WANDERS, 'process_control': {'value': value}}
    with tempfile.TemporaryDirectory() as folder:
        made = {'layers': 1, 'loop_mode': 'open_loop', 'overrides': overrides, 'preset': preset()}
        found = run_many(
            [parts.job(Path(folder), 'block', seed, **made) for seed in SEEDS], workers=workers()
        )
    for r in found:
        if r.failed:
            print(f'process: {value}, seed {r.seed}: {r.message[:120]}', file=sys.stderr)
    return found


def current() -> None:
    """Held by speed and wire together."""
    with_, without = (
        np.array([r.process_variance['current'] for r in in_laboratory(held)])
        for held in ('current', 'none')
    )
    each = ', '.join(f'{a / b:.2f}' for a, b in zip(with_, without, strict=True))
    print(f'{each}; RMS {100 * np.sqrt(without.mean()):.2f} % without', file=sys.stderr)
    ratio = float(with_.mean() / without.mean())
    emit('process.variance_ratio', ratio, '', 'constant feed, same seeds', 1.0)


FIGURES = {'process.variance_ratio': current}
