"""The part that comes out: jobs of the demo's jaw in the laboratory, with the defaults, over many seeds.

One set of jobs gives `shape.in_tolerance_share`, `shape.rms_mean_mm`, `shape.rms_worst_mm`, `shape.rms_edges_mm`,
`shape.largest_mm` (99.5 % of the cells, worst seed), `shape.level_worst_mm` (mean error after layers 4 ... last, any
seed) and `shape.time_ratio`, on the preset that users get. On `gentle` they are
`shape.gentle_in_tolerance_share`, `shape.gentle_rms_mean_mm`, `shape.gentle_rms_worst_mm`, `shape.gentle_rms_edges_mm`,
`shape.gentle_largest_mm`, `shape.gentle_level_worst_mm` and `shape.gentle_time_ratio`. All but a rim of 1 mm along the
edge is judged. `shape.strategies_worst_mm`: worst mean RMS of the strategies.
`shape.plants_worst_mm`: worst mean RMS on cells of other physics than the one that settings were chosen on.
`shape.parts_worst_mm`: worst mean RMS of the six parts of `waam_lab.parts`. `shape.corner_lag_mm`: the block
of 60 x 40 x 60 mm there, built; how far the mean height of its lowest corner lies below that of its middle after the
last layer, in the scan. Corner: a square of CORNER at each corner, less the rim; middle: the middle quarter of the top.
`shape.network_gain_pct`: RMS of jobs with law `unet` against `bead_solver` on the same seeds; the smaller one of
the gains after layers 2 to 5 and at the end; 95 % intervals on stderr. `shape.fallback_share`: share of the layers of
these jobs and of the six parts that the network did not answer.
`shape.pitch_rms_mm`: mean RMS over all strategies with the pitch of the material table, against beads 0.73 of their
width apart; it chooses a setting and so runs on seeds 101 to 105.

Baselines are version 0.1 on its seeds 1, 2, 3, 7 and 11 (equal layers of 2 mm, pitch 0.73), and the same jobs without
correction. Settings were chosen on seeds 101 to 106 and 201 to 206; the seeds here are for reporting only.
`WAAM_BENCH_SEEDS=1,2` chooses others, `WAAM_BENCH_WORKERS` the number of processes (2). A job takes 6 to 10 s. All but
the first figures are those of the preset `gentle`; `WAAM_BENCH_PRESET=recorded` chooses another one, for all.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from lib.jaw import jaw_job
from lib.preset import USUAL, preset
from lib.preset import emit_on_cell as emit
from lib.seeds import seeds

from waam_process.operating import DEFAULT_PRESET

SEEDS = tuple(range(1, 21))
FEW = (1, 2, 3, 4, 5)
FIRST = (1, 2)  # of the block, whose jobs are long
CORNER = 5e-3  # m
STRATEGIES = ('zigzag', 'contour', 'spiral', 'combined')
CHOOSING = (101, 102, 103, 104, 105)
PITCHES = (0.60, 0.73)  # of the bead width: the material table's, and that of version 0.1
OLD = 'version 0.1, gentle, five seeds'
OLD_TIME = 700.0  # s
PLANTS = {  # fields of MetalParams
    'short trail': {'pool_lag': 0.2, 'levelling': 0.35},
    'long trail, narrow bead': {'pool_lag': 0.8, 'levelling': 0.75, 'width_ref': 6.2e-3},
    'noisy, lossy, deep craters': {
        'crater_depth': 0.6,
        'transfer': 0.8,
        'area_noise_layer': 0.06,
    },
}


def jaw_jobs(wanted: tuple[int, ...], **options) -> list:
    """Results of the demo's jaw, one per seed; a job that fails stops the bench with its message."""
    from waam_lab import over_seeds, run_many

    return done(run_many(over_seeds(jaw_job(**options), wanted), workers=workers()))


def workers() -> int:
    return int(os.environ.get('WAAM_BENCH_WORKERS', '2'))


def done(found: list) -> list:
    """The results; RuntimeError with the message of a job that failed."""
    for result in found:
        if result.failed:
            raise RuntimeError(f'seed {result.seed}: {result.message}')
    return found


def part_jobs(name: str, wanted: tuple[int, ...], **options) -> list:
    """Results of a part of waam_lab.parts, one per seed."""
    from waam_lab import over_seeds, parts, run_many

    with tempfile.TemporaryDirectory() as folder:
        job = parts.job(Path(folder), name, tolerance=0.2e-3, preset=preset(), **options)
        return done(run_many(over_seeds(job, wanted), workers=workers()))


def told(name: str, found: list) -> None:
    """One line per set of jobs on stderr."""
    rms = 1e3 * np.array([r.rms for r in found])
    share = np.array([r.share_in_tolerance for r in found])
    print(
        f'{name}: RMS {rms.mean():.3f} mm ({rms.min():.3f} .. {rms.max():.3f}), within tolerance {share.mean():.1%} '
        f'({share.min():.1%} .. {share.max():.1%}), {sum(r.in_tolerance for r in found)} of {len(found)} in tolerance',
        file=sys.stderr,
    )


def jaw() -> None:
    """On the cell that users get, and on the one that settings were chosen on."""
    on = preset(DEFAULT_PRESET)
    jaw_on(on, 'shape.')
    if on != USUAL:
        jaw_on(USUAL, f'shape.{USUAL}_')


def jaw_on(on: str, name: str) -> None:
    """name: what the names of the figures begin with."""
    found = jaw_jobs(seeds(SEEDS), preset=on)
    told(f'jaw, {on}', found)
    rms, edges, largest = (
        1e3 * np.array([getattr(r, k) for r in found]) for k in ('rms', 'rms_edges', 'largest')
    )
    level = max(abs(m) for r in found for m in r.layer_means[3:])
    good = float(np.mean([r.in_tolerance for r in found]))
    time = float(np.mean([r.time for r in found]))
    for figure, value, unit, baseline, old in (
        ('in_tolerance_share', good, '', OLD, 0.0),
        ('rms_mean_mm', float(rms.mean()), 'mm', OLD, 0.192),
        ('rms_worst_mm', float(rms.max()), 'mm', OLD, 0.260),
        ('rms_edges_mm', float(edges.mean()), 'mm', OLD, 0.25),
        ('largest_mm', float(largest.max()), 'mm', OLD + ', maximum', 1.7),
        ('level_worst_mm', 1e3 * level, 'mm', OLD, 0.175),
        ('time_ratio', time / OLD_TIME, '', OLD, 1.0),
    ):
        emit(f'{name}{figure}', value, unit, baseline, old, on)


def strategies() -> None:
    means = {}
    for name in STRATEGIES:
        found = jaw_jobs(seeds(FEW), strategy=name)
        told(name, found)
        means[name] = 1e3 * float(np.mean([r.rms for r in found]))
    emit('shape.strategies_worst_mm', max(means.values()), 'mm', OLD + ', combined', 0.35)


def pitches() -> None:
    means = {}
    for pitch in PITCHES:
        rms = []
        for name in STRATEGIES:
            found = jaw_jobs(
                seeds(CHOOSING), strategy=name, plan_settings=(f'pitch_ratio={pitch}',)
            )
            told(f'pitch {pitch}, {name}', found)
            edges, largest = (
                1e3 * np.mean([getattr(r, k) for r in found]) for k in ('rms_edges', 'largest')
            )
            print(f'  with the rim {edges:.3f} mm, 99.5 % within {largest:.3f} mm', file=sys.stderr)
            rms += [r.rms for r in found]
        means[pitch] = 1e3 * float(np.mean(rms))
    emit('shape.pitch_rms_mm', means[PITCHES[0]], 'mm', 'pitch 0.73', means[0.73])


def law(name: str) -> dict:
    return {'overrides': {'correction_server': {'law': name}}}


def network() -> None:
    laws = ('bead_solver', 'unet')
    without, with_it = (jaw_jobs(seeds(SEEDS), **law(n)) for n in laws)
    told('jaw without the network', without)
    told('jaw with the network', with_it)
    early, late = (
        np.array([[np.mean(r.layer_rms[1:5]), r.rms] for r in found])
        for found in (without, with_it)
    )
    gains = paired_gains(early, late, ('layers 2 to 5', 'end'))
    emit('shape.network_gain_pct', min(gains), '%', 'without the network', 0.0)
    from waam_lab import parts

    found = [*with_it]
    for name in parts.PARTS:
        found += part_jobs(name, seeds(FEW)[:1], **law('unet'))
    share = sum(r.fallbacks for r in found) / sum(r.layers for r in found)
    emit('shape.fallback_share', share, '', 'law unet, 2 of 6 layers', 1 / 3)


def paired_gains(without: np.ndarray, with_it: np.ndarray, names: tuple[str, ...]) -> list[float]:
    """Mean gains in % of the mean without, with their 95 % intervals on stderr. Arrays (jobs, names)."""
    gains = 100 * (without - with_it) / without.mean(axis=0)
    half = 1.96 * gains.std(axis=0, ddof=1) / max(len(gains), 1) ** 0.5
    for name, mean, room in zip(names, gains.mean(axis=0), half, strict=True):
        print(
            f'gain, {name}: {mean:.1f} % ({mean - room:.1f} .. {mean + room:.1f})', file=sys.stderr
        )
    return [float(g) for g in gains.mean(axis=0)]


def plants() -> None:
    from waam_lab import params
    from waam_sim.config import plant_params

    usual, worst = plant_params(params.make(preset=preset()).cell), (0.0, 1.0)
    for name, changed in PLANTS.items():
        plant = replace(usual, metal=replace(usual.metal, **changed))
        closed = jaw_jobs(seeds(FEW), plant=plant)
        told(name, closed)
        without = jaw_jobs(seeds(FEW)[:1], plant=plant, loop_mode='open_loop')
        figures = tuple(1e3 * float(np.mean([r.rms for r in rs])) for rs in (closed, without))
        worst = max(worst, figures)
    emit('shape.plants_worst_mm', worst[0], 'mm', 'open loop on the same plant', worst[1])


def of_parts() -> None:
    from waam_lab import parts

    means = {}
    for name in parts.PARTS:
        found = part_jobs(name, seeds(FEW))
        told(name, found)
        means[name] = 1e3 * float(np.mean([r.rms for r in found]))
    emit('shape.parts_worst_mm', max(means.values()), 'mm', OLD + ', L, ring, cylinder', 0.37)


def corners(height: np.ndarray, region: np.ndarray, cell: float) -> Iterator[float]:
    """m: mean height of the middle of a rectangular region over that of each of its corners.

    height: (rows, cols) m; cell: m.
    """
    rows, cols = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    top = height[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    n, m = (int(k / 4) for k in top.shape)
    middle = float(np.nanmean(top[n:-n, m:-m]))
    a, b = round(1e-3 / cell), round(CORNER / cell)
    for one in (top, top[::-1]):
        for corner in (one[a:b, a:b], one[a:b, ::-1][:, a:b]):
            yield middle - float(np.nanmean(corner))


def block() -> None:
    found = part_jobs('block', seeds(FIRST))
    lags = [max(corners(r.maps.error, r.maps.region, r.maps.spec.resolution)) for r in found]
    text = ', '.join(f'seed {r.seed} {1e3 * lag:.2f}' for r, lag in zip(found, lags, strict=True))
    print(f'block, lowest corner below the middle, mm: {text}', file=sys.stderr)
    emit('shape.corner_lag_mm', 1e3 * max(lags), 'mm', 'version 0.1, 17 layers', 7.0)


FIGURES = {
    'shape.in_tolerance_share': jaw,
    'shape.rms_mean_mm': jaw,
    'shape.rms_worst_mm': jaw,
    'shape.rms_edges_mm': jaw,
    'shape.largest_mm': jaw,
    'shape.level_worst_mm': jaw,
    'shape.time_ratio': jaw,
    'shape.gentle_in_tolerance_share': jaw,
    'shape.gentle_rms_mean_mm': jaw,
    'shape.gentle_rms_worst_mm': jaw,
    'shape.gentle_rms_edges_mm': jaw,
    'shape.gentle_largest_mm': jaw,
    'shape.gentle_level_worst_mm': jaw,
    'shape.gentle_time_ratio': jaw,
    'shape.strategies_worst_mm': strategies,
    'shape.plants_worst_mm': plants,
    'shape.parts_worst_mm': of_parts,
    'shape.network_gain_pct': network,
    'shape.fallback_share': network,
    'shape.corner_lag_mm': block,
    'shape.pitch_rms_mm': pitches,
}
