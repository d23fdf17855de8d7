"""The process control: a chosen value held by the feed override, in whole jobs on the simulated cell.

The cell's contact tip and wire wander (arc_tip_wander 1.2 mm in 4 s, arc_feed_wander 4 % in 6 s: the current of a job
scatters as that of a recorded one, see waam_sim/README.md). One layer of a block of 60 x 40 mm, open loop, seeds 1-20.

process.variance_ratio: variance of the true arc current, of means over 0.5 s (in which the pool travels its own length)
in straight steady travel from 1.5 s after each strike on. Mean over the seeds. Baseline: constant feed, same seeds.
process.variance_ratio_heat_input: the same of the heat input, held by speed and wire.
process.variance_ratio_raw: current, single values every 10 ms, with the noise of the arc's length, which no feed can
follow.
process.variance_ratio_pulses: current, by the pulses of source 004.

width.rms_mm: true mean bead width of a layer (pool, straight steady travel) less the planned 7.0 mm, layers 2 and 3 of
whole closed-loop jobs: three layers of a block of 60 x 40 mm on a plate, seeds 1-20. The cell's beads are up to 8 %
wider or narrower than those of its data sheet; contact tip and wire wander. Voltage control (hold_width) by the widths
that the scans of the same job show. Baseline: constant voltage, same seeds.
width.error_mm: measured width less the true mean of the layer, RMS. Baseline: the uncertainty that was given.
"""

from __future__ import annotations

import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from bench_shape import workers
from lib.preset import emit_on_cell as emit
from lib.preset import preset
from lib.seeds import seeds

SEEDS = seeds(tuple(range(1, 21)))
WANDERS = {'arc_tip_wander': 1.2e-3, 'arc_feed_wander': 0.04}
WIDTH, LAYERS = 7.0, 3  # mm, wanted


@cache
def in_laboratory(value: str, output: str = 'override') -> list:
    """Results with this value held; 'none' = constant feed."""
    from waam_lab import parts, run_many

    overrides = {'cell': WANDERS, 'process_control': {'value': value, 'output': output}}
    with tempfile.TemporaryDirectory() as folder:
        made = {'layers': 1, 'loop_mode': 'open_loop', 'overrides': overrides, 'preset': preset()}
        found = run_many(
            [parts.job(Path(folder), 'block', seed, **made) for seed in SEEDS], workers=workers()
        )
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
def _widths(held: bool) -> list:
    """Results of whole jobs with the bead width held by the voltage, or with constant voltage."""
    from waam_lab import parts, run_many

    def made(seed: int) -> dict:
        sheet = 7e-3 * np.random.default_rng([seed, 7]).uniform(0.92, 1.08)
        cell = {**WANDERS, 'metal_width_ref': float(sheet)}
        overrides = {'cell': cell, 'correction_server': {'hold_width': held}}
        own = {'overrides': overrides, 'preset': preset()}
        return {'layers': LAYERS, 'bead_width': 1e-3 * WIDTH, **own}

    with tempfile.TemporaryDirectory() as folder:
        found = run_many(
            [parts.job(Path(folder), 'block', seed, **made(seed)) for seed in SEEDS],
            workers=workers(),
        )
    for r in found:
        if r.failed:
            print(f'width: seed {r.seed}: {r.message[:120]}', file=sys.stderr)
    return [r for r in found if not r.failed]


def _measured(results: list) -> np.ndarray:
    """(n, 3) mm: measured mean width of a layer, its uncertainty, true mean."""
    rows = [
        (1e3 * row['bead_width'], 1e3 * row['bead_width_u'], 1e3 * r.bead_widths[layer])
        for r in results
        for row in r.reports
        for layer in (row['layer'] - (0 if row['final'] else 1),)
        if row['bead_width'] is not None and layer in r.bead_widths
    ]
    return np.array(rows, float).reshape(-1, 3)


def width() -> None:
    """With voltage control over constant voltage; and how well the widths were measured."""
    held, free = _widths(True), _widths(False)
    off = [
        np.array([[1e3 * r.bead_widths[k] - WIDTH for k in range(2, LAYERS + 1)] for r in found])
        for found in (held, free)
    ]
    each = ', '.join(
        f'{a:.2f}/{b:.2f}'
        for a, b in zip(*(np.sqrt(np.mean(o**2, axis=1)) for o in off), strict=True)
    )
    print(f'width.rms_mm: with/without, by seed: {each}', file=sys.stderr)
    with_, without = (float(np.sqrt(np.mean(o**2))) for o in off)
    emit('width.rms_mm', with_, 'mm', 'constant voltage, same seeds', without)
    seen, u, true = _measured(held + free).T
    print(
        f'width.error_mm: {len(seen)} layers measured, mean {np.mean(seen - true):+.3f} mm',
        file=sys.stderr,
    )
    given = float(np.sqrt(np.mean(u**2)))
    emit(
        'width.error_mm',
        float(np.sqrt(np.mean((seen - true) ** 2))),
        'mm',
        'uncertainty that was given',
        given,
    )


FIGURES = {
    'width.rms_mm': width,
    'width.error_mm': width,
    'process.variance_ratio': current,
    'process.variance_ratio_raw': current,
    'process.variance_ratio_heat_input': heat_input,
    'process.variance_ratio_pulses': pulses,
}
