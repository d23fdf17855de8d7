"""The process control: a chosen value held by the feed override, in whole jobs on the simulated cell.

The cell's contact tip and wire wander (arc_tip_wander 1.2 mm in 4 s, arc_feed_wander 4 % in 6 s: the current of a job
scatters as that of a recorded one, see waam_sim/README.md). One layer of a block of 60 x 40 mm, open loop, seeds 1-20.

process.variance_ratio: variance of the true arc current, of means over 0.5 s (in which the pool travels its own length)
in straight steady travel from 1.5 s after each strike on. Mean over the seeds. Baseline: constant feed, same seeds.
process.variance_ratio_heat_input: the same of the heat input, held by speed and wire.
process.variance_ratio_raw: current, single values every 10 ms, with the noise of the arc's length, which no feed can
follow.
process.variance_ratio_pulses: current, by the pulses of source 004.

width.rms_mm: true mean width of a bead less 7.0 mm, beads 2 to 8 of eight that stand free on a plate which they warm,
each measured by the scanner before the next one is laid (lib/width_beads.py), seeds 1-20. Baseline: constant voltage,
same seeds.
width.error_mm: measured width of those beads less the true one, RMS. Baseline: the uncertainty that was given.
"""

from __future__ import annotations

import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.seeds import seeds

SEEDS = seeds(tuple(range(1, 21)))
WANDERS = {'arc_tip_wander': 1.2e-3, 'arc_feed_wander': 0.04}


@cache
def in_laboratory(value: str, output: str = 'override') -> list:
    """Results with this value held; 'none' = constant feed."""
    from waam_lab import parts, run_many

    overrides = {'cell': WANDERS, 'process_control': {'value': value, 'output': output}}
    with tempfile.TemporaryDirectory() as folder:
        made = {'layers': 1, 'profile': 'open_loop', 'overrides': overrides}
        found = run_many([parts.job(Path(folder), 'block', seed, **made) for seed in SEEDS])
    for r in found:
        if r.failed:
            print(f'process: {value}, seed {r.seed}: {r.message[:120]}', file=sys.stderr)
    return found


def ratio(name: str, value: str, output: str = 'override', raw: bool = False) -> None:
    """Emits the mean variance with control over that without."""
    which = 'process_variance_raw' if raw else 'process_variance'
    with_, without = (
        np.array([getattr(r, which)[value] for r in in_laboratory(*kind)])
        for kind in ((value, output), ('none',))
    )
    each = ', '.join(f'{a / b:.2f}' for a, b in zip(with_, without, strict=True))
    print(f'{name}: {each}; RMS {100 * np.sqrt(without.mean()):.2f} % without', file=sys.stderr)
    both = float(with_.mean() / without.mean())
    emit(name, both, '', 'constant feed, same seeds', 1.0)


def current() -> None:
    """Held by speed and wire together."""
    ratio('process.variance_ratio', 'current')
    ratio('process.variance_ratio_raw', 'current', raw=True)


def heat_input() -> None:
    """Held by speed and wire together."""
    ratio('process.variance_ratio_heat_input', 'heat_input')


def pulses() -> None:
    """Held by the pulses of the source."""
    ratio('process.variance_ratio_pulses', 'current', 'pulses')


@cache
def _beads(controlled: bool) -> np.ndarray:
    """(seeds, beads, 3) mm."""
    from lib.width_beads import beads

    return 1e3 * np.array([beads(seed, controlled) for seed in SEEDS])


def width() -> None:
    """With voltage control over constant voltage; and how well the widths were measured."""
    from lib.width_beads import WIDTH

    held, free = _beads(True), _beads(False)
    off = [1e3 * WIDTH - found[:, 1:, 0] for found in (held, free)]
    each = ', '.join(
        f'{a:.2f}/{b:.2f}'
        for a, b in zip(*(np.sqrt(np.mean(o**2, axis=1)) for o in off), strict=True)
    )
    print(f'width.rms_mm: with/without, by seed: {each}', file=sys.stderr)
    with_, without = (float(np.sqrt(np.mean(o**2))) for o in off)
    emit('width.rms_mm', with_, 'mm', 'constant voltage, same seeds', without)
    wrong = float(np.sqrt(np.mean((held[..., 1] - held[..., 0]) ** 2)))
    given = float(np.sqrt(np.mean(held[..., 2] ** 2)))
    emit('width.error_mm', wrong, 'mm', 'uncertainty that was given', given)


FIGURES = {
    'width.rms_mm': width,
    'width.error_mm': width,
    'process.variance_ratio': current,
    'process.variance_ratio_raw': current,
    'process.variance_ratio_heat_input': heat_input,
    'process.variance_ratio_pulses': pulses,
}
