"""Adaptation: what corrections leave on pads and walls, beside the baselines, on the same seeds.

adapt.pad_gap_closed: share of the gap between the best explicit law (each with its best gain) and the oracle (knows the
  plant, not its noise) that the default law closes (network and bead model; the ablation tells them apart); pads of 20
  layers (bench/lib/adapt_plants.py).
adapt.wall_rms_trimmed_mm, adapt.wall_rms_all_mm: final top of a 100-layer single-bead wall fitted to a recording
  (bench/lib/adapt_wall.py), without and with two segments at each end (baseline: the published cell).
adapt.transfer_worst_ratio: largest RMS of the network over that of the best explicit law, pads unlike training.
adapt.service_p99_ms: round trip of the real service, 256 x 256 cells, new beads in every call, announced beforehand as
  a job does and as warm as the layer before, conversion included (baseline: what was asked). The table also has calls
  that were not announced.
thermal.wait_error_pct: mean error of the predicted wait for an interpass limit, recorded wall (baseline: exponential).
Tables, only when asked for by name: adapt.wall_fit (the fit of the wall to the recordings) and adapt.ablation (the
chain without one of its parts).
Environment: WAAM_BENCH_LAW (default: that of correction_server) the law in the network's place, WAAM_BENCH_COUNT
(default 10) seeds of pads, twice as many walls; WAAM_BENCH_CALLS (default 300) service calls.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace

import numpy as np
from lib import adapt_wall
from lib.adapt_loop import Settings, log_log, open_loop, pad_oracle, run, wall_oracle
from lib.adapt_plants import Pad, PadPhysics, transfer_plants
from lib.adapt_stats import interval, progress, table, text
from lib.adapt_wall import Wall
from lib.emit import emit

from waam_adapt.laws.corrector import CorrectionParams

LAW = os.environ.get('WAAM_BENCH_LAW', CorrectionParams().law)
SEEDS = range(int(os.environ.get('WAAM_BENCH_COUNT', '10')))
CALLS = int(os.environ.get('WAAM_BENCH_CALLS', '300'))
EXPLICIT = ['damped_inverse', 'proportional']
GAINS = (0.3, 0.5, 0.7, 0.9, 1.1)
PAD_LAYERS, WALL_LAYERS = 20, 100


def last(runs: list) -> np.ndarray:
    """(seeds, 3) m: figures of the final tops."""
    return np.array([r.figures[-1] for r in runs])


def pads(settings: Settings, physics: PadPhysics, what: str = '') -> np.ndarray:
    return last(pad_runs(settings, physics, what))


def pad_runs(settings: Settings, physics: PadPhysics, what: str = '') -> list:
    seeds = progress(SEEDS, what or f'{settings.law} {settings.gain}')
    return [run(Pad(s, physics), settings, PAD_LAYERS) for s in seeds]


def best(
    law: str, physics: PadPhysics, gains: tuple[float, ...] = GAINS
) -> tuple[float, np.ndarray]:
    """The gain with the smallest mean RMS, and its figures."""
    found = {g: pads(Settings(law, g), physics) for g in gains}
    gain = min(found, key=lambda g: found[g][:, 1].mean())
    return gain, found[gain]


def bench_pads() -> None:
    plant = PadPhysics()
    rows = {'open loop': last([open_loop(Pad(s, plant), PAD_LAYERS) for s in SEEDS])}
    explicit = {}
    for law in EXPLICIT:
        gain, explicit[law] = best(law, plant)
        rows[f'{law}, gain {gain}'] = explicit[law]
    top = min(explicit.values(), key=lambda f: f[:, 1].mean())
    gain, ours = best(LAW, plant, gains=(0.9, 1.1))
    rows[f'{LAW}, gain {gain}'] = ours
    floor = last([pad_oracle(Pad(s, plant), PAD_LAYERS) for s in progress(SEEDS, 'oracle')])
    rows['oracle'] = floor
    table(
        f'Pads, {PAD_LAYERS} layers of 2 mm, {len(SEEDS)} seeds: mean [95 %] after the last layer, mm',
        ('law', 'RMS', 'RMS without the last 5 mm', 'worst end (mean over 5 mm)'),
        [(name, text(f[:, 1]), text(f[:, 0]), text(f[:, 2])) for name, f in rows.items()],
    )
    parts = np.stack([top[:, 1], ours[:, 1], floor[:, 1]], axis=1)
    share, low, high = interval(parts, _closed)
    note = (
        f'best explicit {top[:, 1].mean() * 1e3:.3f}, {LAW} {ours[:, 1].mean() * 1e3:.3f}, oracle '
    )
    note += f'{floor[:, 1].mean() * 1e3:.3f} mm; 95 % {low:.2f} .. {high:.2f}'
    emit('adapt.pad_gap_closed', share, '1', f'asked; {note}', 0.7)


def _closed(parts: np.ndarray, axis: int | None = None) -> float:
    top, ours, floor = parts.mean(axis=0)
    return (top - ours) / (top - floor)


def bench_walls() -> None:
    seeds = range(2 * len(SEEDS))
    explicit = Settings('damped_inverse')
    rows = {
        'open loop': [open_loop(Wall(s), WALL_LAYERS) for s in seeds],
        'log-log inverse of the recorded model': [log_log(Wall(s), WALL_LAYERS) for s in seeds],
    }
    for s in dict.fromkeys((explicit, replace(explicit, identify=False), Settings(LAW))):
        name = s.law + ('' if s.identify else ', without identification')
        rows[name] = [run(Wall(n), s, WALL_LAYERS) for n in progress(seeds, name)]
    rows['oracle'] = [wall_oracle(Wall(s), WALL_LAYERS) for s in seeds]
    figures = {name: last(r) for name, r in rows.items()}
    table(
        f'Walls, {WALL_LAYERS} layers, {len(seeds)} seeds: RMS of the final top, mm, mean [95 %]',
        ('law', 'trimmed', 'all', 'worst end', 'mean of layers 21 .. 100, trimmed'),
        [
            (n, text(f[:, 0]), text(f[:, 1]), text(f[:, 2]), text([_late(r) for r in rows[n]]))
            for n, f in figures.items()
        ],
    )
    found = np.mean([r.exponent[-1] for r in rows['damped_inverse']])
    print(
        f'identified exponent at the end: {found:.2f} (plant {Wall().physics.a})', file=sys.stderr
    )
    for column, name, published in ((0, 'trimmed', 0.227), (1, 'all', 0.529)):
        value, floor = (figures[k][:, column].mean() * 1e3 for k in (LAW, 'oracle'))
        plain = figures['damped_inverse'][:, column].mean() * 1e3
        note = f'published LSTM; {LAW}; damped_inverse {plain:.3f}, oracle {floor:.3f} mm'
        emit(f'adapt.wall_rms_{name}_mm', value, 'mm', note, published)


def _late(r) -> float:
    return float(np.mean(np.array(r.figures)[20:, 0]))


def bench_transfer() -> None:
    rows, worst = [], (0.0, '')
    for name, plant in transfer_plants().items():
        explicit = {law: best(law, plant) for law in EXPLICIT}
        law = min(explicit, key=lambda k: explicit[k][1][:, 1].mean())
        top, ours = explicit[law][1], pads(Settings(LAW), plant)
        ratio = ours[:, 1].mean() / top[:, 1].mean()
        worst = max(worst, (ratio, name))
        rows.append(
            (name, f'{law} {explicit[law][0]}', text(top[:, 1]), text(ours[:, 1]), f'{ratio:.3f}')
        )
    table(
        f'Transfer: pads outside the training, {len(SEEDS)} seeds, RMS in mm, mean [95 %]',
        ('plant', 'best explicit law, gain', 'its RMS', LAW, 'ratio'), rows,
    )  # fmt: skip
    _confidence()
    emit('adapt.transfer_worst_ratio', worst[0], '1', f'asked; worst on: {worst[1]}', 1.1)


def _confidence() -> None:
    """Does a low confidence go with a large error? Cells of the last ten layers, plants in and outside the training."""
    from scipy.stats import spearmanr

    rows = []
    for name, plant in {'as trained': PadPhysics(), **transfer_plants()}.items():
        runs = [run(Pad(s, plant), Settings(LAW), PAD_LAYERS) for s in list(SEEDS)[:3]]
        sure = np.concatenate([np.concatenate(r.confidence[10:]) for r in runs])
        off = np.concatenate([np.concatenate(r.missed[10:]) for r in runs])
        low, high = np.quantile(sure, [0.1, 0.9])
        rms = [np.sqrt(np.mean(off[p] ** 2)) * 1e3 for p in (sure <= low, sure >= high)]
        falls = sum(r.fallbacks for r in runs)
        rows.append(
            (
                name,
                f'{spearmanr(sure, off).statistic:+.2f}',
                f'{sure.mean():.2f}',
                f'{rms[0]:.3f}',
                f'{rms[1]:.3f}',
                falls,
            )
        )
    table(
        'Confidence and the error that followed, cell by cell',
        ('plant', 'rank correlation', 'mean confidence', 'RMS of the least sure tenth', 'of the surest', 'fallbacks'),
        rows,
    )  # fmt: skip


def ablation() -> None:
    """The chain without one of its parts, on pads that heat up, and on walls."""
    full = Settings(LAW)
    variants = {
        'complete': full,
        'without network (bead model alone)': replace(full, model='none'),
        'without both (damped_inverse)': replace(full, law='damped_inverse'),
        'without identification': replace(full, identify=False),
        'without thermal term': replace(full, thermal=False),
        'without confidence (sigma unknown)': replace(full, confidence=False),
    }
    rows = []
    for name, s in variants.items():
        runs = pad_runs(s, PadPhysics(), name)
        p, early = last(runs), [np.mean(np.array(r.figures)[1:5, 1]) for r in runs]
        hot = pads(s, PadPhysics(heat=2.0), name)
        w = last([run(Wall(n), s, WALL_LAYERS) for n in progress(SEEDS, name)])
        rows.append((name, text(early), *(text(v) for v in (p[:, 1], hot[:, 1], w[:, 0], w[:, 1]))))
    table(
        'Ablation: RMS after layers 2 to 5 of the pad, and after the last layer, mm, mean [95 %]',
        ('chain', 'pad, 2 to 5', 'pad', 'pad, doubled heat', 'wall, trimmed', 'wall, all'), rows,
    )  # fmt: skip


def bench_service() -> None:
    from lib import adapt_latency

    laws = ('damped_inverse', LAW, CorrectionParams.law)
    rows = {law: adapt_latency.measure(law, CALLS) for law in dict.fromkeys(laws)}
    law = CorrectionParams.law
    alone = {f'{law}, not announced': adapt_latency.measure(law, CALLS // 3, announced=False)}
    head = ('p50', 'p99', 'max', 'server_p99', 'memory_mb', 'fallbacks')
    table(
        f'Service, 256 x 256 cells, {CALLS} calls: ms (load of this machine now: {os.getloadavg()[0]:.1f})',
        ('law', *head), [(k, *(f'{v[h]:.1f}' for h in head)) for k, v in (rows | alone).items()],
    )  # fmt: skip
    name, slowest = max(rows.items(), key=lambda row: row[1]['p99'])
    note = f'limit that was asked; {name}; server {slowest["memory_mb"]:.0f} MB'
    emit('adapt.service_p99_ms', slowest['p99'], 'ms', note, 60.0)


def hot_walls() -> None:
    """Walls of 40 layers, interpass temperature rising from 20 to 400 degC: how far ten layers are off nominal."""
    physics = [replace(Wall().physics, kt=k, warm_up=0.0) for k in (6e-4, 7.5e-4, 9e-4)]
    rows = []
    for name, s in {
        'complete': Settings('damped_inverse'),
        'Kt alone (law zero, not identified)': Settings('zero', identify=False),
        'neither': Settings('zero', identify=False, thermal=False),
    }.items():
        runs = [
            run(Wall(n, p), s, 40, ramp=(20.0, 400.0)) for p in physics for n in list(SEEDS)[:3]
        ]
        ten = np.array(
            [
                [(r.level[k + 9] - (r.level[k - 1] if k else 0.0)) for k in (0, 10, 20, 30)]
                for r in runs
            ]
        )
        off = ten / 10 / Wall().nominal.mean() * 100
        rows.append((name, *(f'{m:+.2f}' for m in off.mean(axis=0)), f'{np.abs(off).max():.2f}'))
    head = ('chain', '20 .. 108 degC', '.. 205', '.. 303', '.. 400', 'largest')
    table(
        'Simulated wall, 20 to 400 degC, three strengths of the effect: % off nominal height, ten layers each',
        head,
        rows,
    )


def bench_thermal() -> None:
    from lib import adapt_thermal

    hot_walls()

    found = adapt_thermal.all_forecasts()
    if not found:
        print(f'thermal.wait_error_pct: no recording in {adapt_thermal.FOLDER}', file=sys.stderr)
        return
    groups = [
        (
            f'learned, asked at {a:.0%} of the dwell',
            [f for f in found if f.learned and f.asked == a],
        )
        for a in adapt_thermal.ASKED
    ]
    groups += [
        ('all, learned', [f for f in found if f.learned]),
        ('first layers, nothing learned yet', [f for f in found if not f.learned]),
    ]
    rows = []
    for name, some in groups:
        e, single = (np.abs([getattr(f, k) for f in some]) * 100 for k in ('error', 'single'))
        layers = len({(f.wall, f.dwell) for f in some})
        rows.append(
            (
                name,
                len(some),
                layers,
                f'{np.median(e):.1f}',
                f'{e.mean():.1f}',
                f'{np.quantile(e, 0.9):.1f}',
                f'{(e <= 15).mean():.0%}',
                f'{single.mean():.1f}',
            )
        )
    table(
        'Predicted wait for an interpass limit, recorded wall: error in %',
        ('', 'limits', 'layers', 'median', 'mean', '90 %', 'within 15 %', 'one exponential, mean'), rows,
    )  # fmt: skip
    learned = [f for f in found if f.learned]
    value = float(np.mean(np.abs([f.error for f in learned])) * 100)
    inside = float(np.mean(np.abs([f.error for f in learned]) <= 0.15))
    single = float(np.mean(np.abs([f.single for f in learned])) * 100)
    emit(
        'thermal.wait_error_pct',
        value,
        '%',
        f'one exponential; {len(learned)} limits, {inside:.0%} within 15 %',
        single,
    )


FIGURES = {
    'adapt.pad_gap_closed': bench_pads,
    'adapt.wall_rms_trimmed_mm': bench_walls,
    'adapt.wall_rms_all_mm': bench_walls,
    'adapt.transfer_worst_ratio': bench_transfer,
    'adapt.service_p99_ms': bench_service,
    'thermal.wait_error_pct': bench_thermal,
}
TABLES = {'adapt.wall_fit': adapt_wall.print_fit, 'adapt.ablation': ablation}
