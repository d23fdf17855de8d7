"""What can be gained while a layer is laid and right after it: jobs of the demo's jaw in the laboratory.

inlayer.scan_time_ratio: time in state SCANNING, ways to the scans included, with passes over what a layer has changed
(`scan_changed_only`) over that with passes over the whole part; the same for inlayer.job_time_ratio (whole job) and
inlayer.scan_rms_ratio (RMS at the end), all paired over seeds. 95 % intervals on stderr.
inlayer.rms_ratio: RMS at the end with corrections within the layers (`in_layer`) over that without, paired; measured
together with inlayer.bound_rms_ratio, below which nobody who measures the disturbance can come (docs/in_layer.md).
inlayer.within_scan_time_ratio, inlayer.within_scan_rms_ratio: time in state SCANNING and RMS with `in_layer` and
`scan_changed_only`, whose passes leave out what was seen well beside the arc, over those with neither.
inlayer.rail_scan_time_ratio, inlayer.rail_scan_rms_ratio, inlayer.rail_job_time_ratio, inlayer.plate_scan_time_ratio,
inlayer.plate_scan_rms_ratio, inlayer.plate_job_time_ratio: the same and the whole time, for all layers of the rail and
the plate (below), of which the scanner sees much finished.
inlayer.lost, inlayer.doubled: segments that were skipped, and ones that ran twice or with other setpoints than the ones
accepted last, in the noise campaign (real bridge core, real controller core, bad cable, pulled plugs, stalls) while
setpoints are replaced all the time; baseline: setpoints replaced. `WAAM_BENCH_NOISE` segments (4000).
inlayer.kill_arc_off_ms: longest time from the death of a node or of the bridge to the arc being out, jobs whose layer
is corrected within, in the laboratory, at random moments and within 1 s after every correction, seeds 1 to 20.
Baseline: the lease.
inlayer.graph_kill_arc_off_ms: the same with real processes, kill -9 of one node, from the last heartbeat that it can
have sent; inlayer.cuts_failed: killed jobs that were not resumed to their end, a layer that was cut off with
corrections within its rest included; baseline: kills. inlayer.cut_beads_wrong: beads missing or doubled in them.
`WAAM_BENCH_KILLS` kills (8), `WAAM_BENCH_CUTS` as in bench_job.py.
inlayer.usual_rms_ratio, inlayer.spool_rms_ratio, inlayer.drift_rms_ratio, inlayer.wrong_map_rms_ratio,
inlayer.warp_rms_ratio: RMS with `in_layer` over that without, paired, one layer, the first of its job, of a rail of 170
x 30 mm in cells with something to know within the layer (lib/inlayer_regimes.py); inlayer.usual_plate_rms_ratio,
inlayer.spool_plate_rms_ratio: of a plate of 130 x 60 mm. Seeds 1 to 5.
inlayer.renew_ms: a renewal by the correction service without messages' ways, median of 20, grid of the jaw.
inlayer.bound_rms_ratio: RMS at the end of cells whose metal has no disturbance over that of the same cells with it.
Nobody who sees the beads of a layer one by one can know more of the disturbance than that there is none.
inlayer.seen_pct: share of a layer that the scanner beside the torch sees finished while the arc burns, largest over the
moments at which looking begins; mean over the layers, of the worst seed. Finished: no bead of the layer comes nearer
than REACH any more. Whole footprints would be 100.

Settings were chosen on seeds 101 to 104. `WAAM_BENCH_SEEDS=1,2` chooses others, `WAAM_BENCH_WORKERS` the number of
processes (2). A job takes 12 to 20 s of a core.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from bench_shape import jaw_jobs, workers
from lib.emit import emit
from lib.paths import SOURCES
from lib.seeds import seeds

from waam_plan.post.store import load_plan
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

SEEDS = tuple(range(1, 21))
CALM = dict.fromkeys(('metal_area_noise_fixed', 'metal_area_noise_layer', 'metal_width_noise'), 0.0)
REACH = 4.5e-3  # m from its path that a bead changes the surface
STEP = 1e-3  # m between the points of a path
ONLY = {'job_sequencer': {'scan_changed_only': True}}
WITHIN = {'job_sequencer': {'in_layer': True}}
BOTH = {'job_sequencer': {'in_layer': True, 'scan_changed_only': True}}
NOISE = int(os.environ.get('WAAM_BENCH_NOISE', '4000'))
SERVICE_MS = 60.0  # limit of the correction service


def told(name: str, ratios: np.ndarray) -> float:
    """The mean ratio; its 95 % interval goes to stderr."""
    from scipy import stats

    n = len(ratios)
    half = stats.t.ppf(0.975, n - 1) * ratios.std(ddof=1) / np.sqrt(n) if n > 1 else np.nan
    print(f'{name}: {ratios.mean():.4f} +- {half:.4f} ({n} seeds)', file=sys.stderr)
    return float(ratios.mean())


def ratios(new: list, old: list, name: str) -> np.ndarray:
    """One ratio per seed of a figure of the results."""
    return np.array([getattr(a, name) / getattr(b, name) for a, b in zip(new, old, strict=True)])


def changed_only() -> None:
    only = jaw_jobs(seeds(SEEDS), overrides=ONLY)
    for figure, name in (
        ('inlayer.scan_time_ratio', 'scan_time'),
        ('inlayer.job_time_ratio', 'time'),
        ('inlayer.scan_rms_ratio', 'rms'),
    ):
        emit(
            figure, told(figure, ratios(only, usual(), name)), '', 'passes over the whole part', 1.0
        )


@lru_cache
def usual() -> list:
    """Both figures of corrections within the layer are against the same jobs."""
    return jaw_jobs(seeds(SEEDS))


def within() -> None:
    name = 'inlayer.rms_ratio'
    found = jaw_jobs(seeds(SEEDS), overrides=WITHIN)
    corrected = sum(r['in_layer_corrections'] for job in found for r in job.reports)
    print(f'{corrected} corrections in {len(found)} jobs', file=sys.stderr)
    emit(name, told(name, ratios(found, usual(), 'rms')), '', 'corrections between layers', 1.0)


def within_scan() -> None:
    both = jaw_jobs(seeds(SEEDS), overrides=BOTH)
    for figure, name in (
        ('inlayer.within_scan_time_ratio', 'scan_time'),
        ('inlayer.within_scan_rms_ratio', 'rms'),
    ):
        emit(figure, told(figure, ratios(both, usual(), name)), '', 'whole passes, no looks', 1.0)


def replaced() -> None:
    sys.path.insert(0, str(SOURCES / 'waam_bridge' / 'test'))
    from bridge_campaign import Campaign

    report = Campaign(NOISE, seed=1, replacing=0.2).run()
    for text in report.third:
        print(text, file=sys.stderr)
    doubled = sum('reported after' in t or 'wire' in t for t in report.third)
    for name, value in (('lost', len(report.third) - doubled), ('doubled', doubled)):
        emit(f'inlayer.{name}', value, '', 'setpoints replaced', report.replaced)


def in_regime(figure: str, which: str, part: str) -> Callable[[], None]:
    """What measures this figure."""

    def measure() -> None:
        regime(which, part, figure)

    return measure


def regime(which: str, part: str, figure: str) -> None:
    from lib.inlayer_regimes import jobs

    some = seeds((1, 2, 3, 4, 5))
    with_ = jobs(which, part, some, {'in_layer': True}, workers())
    without = jobs(which, part, some, {'in_layer': False}, workers())
    rows = [row for r in with_ for row in r.reports if row['in_layer_looks']]
    change = max((row['in_layer_change'] for row in rows), default=0.0)
    corrections = sum(row['in_layer_corrections'] for row in rows)
    seen = np.mean([row['in_layer_seen'] for row in rows]) if rows else 0.0
    each = ', '.join(
        f'{1e3 * a.rms:.3f}/{1e3 * b.rms:.3f}' for a, b in zip(with_, without, strict=True)
    )
    print(
        f'{which}, {part}: with/without {each} mm; {corrections} corrections, largest change {change:.3f}, '
        f'{seen:.0%} of the layer seen',
        file=sys.stderr,
    )
    emit(figure, told(figure, ratios(with_, without, 'rms')), '', 'corrections between layers', 1.0)


def passes(part: str) -> None:
    """Time spent scanning and RMS of jobs whose passes are made only where profiles beside the arc do not suffice."""
    from lib.inlayer_regimes import jobs

    some, layers = seeds((1, 2, 3, 4, 5)), 3
    new = jobs('usual', part, some, BOTH['job_sequencer'], workers(), layers)
    old = jobs('usual', part, some, {'in_layer': False}, workers(), layers)
    said = [r for job in new[:1] for row in job.reports for r in row['reasons'] if 'pass ' in r]
    print('\n'.join(said), file=sys.stderr)
    for of, name in OF_PASSES.items():
        figure = f'inlayer.{part}_{of}'
        emit(figure, told(figure, ratios(new, old, name)), '', 'whole passes, no looks', 1.0)


def kills() -> None:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from lib.inlayer_kills import KINDS, of_seed

    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(workers(), get_context('spawn')) as pool,
    ):
        paths = [Path(folder) / f'seed_{seed}' for seed in seeds(SEEDS)]
        some = pool.map(of_seed, paths, seeds(SEEDS))
        found = [kill for per_seed in some for kill in per_seed]
    for kind in KINDS:
        off = [k.off for k in found if k.kind == kind]
        print(
            f'{kind}: {len(off)} kills, arc out after {max(off, default=0):.3f} s', file=sys.stderr
        )
    print(f'{len(found)} kills', file=sys.stderr)
    emit('inlayer.kill_arc_off_ms', 1e3 * max(k.off for k in found), 'ms', 'arc lease', 500.0)


def graph_kills() -> None:
    from lib.inlayer_cuts import run_campaign

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as folder:
        file = Path(os.environ.get('WAAM_BENCH_CUTS', Path(folder) / 'cuts.jsonl')).resolve()
        file.parent.mkdir(parents=True, exist_ok=True)
        lines = run_campaign(
            Path(folder) / 'cuts', file, int(os.environ.get('WAAM_BENCH_KILLS', 8))
        )
    cut = [d for d in lines if d['kind'] == 'kill']
    jobs = [d for d in lines if d['kind'] == 'job']
    late = max(d['off_ms'] for d in cut)
    within = sum(d['resumed_corrections'] for d in jobs)
    print(
        f'{len(cut)} kills, {len(jobs)} jobs; corrections in rests of layers: {within}; RMS '
        f'{[round(d["rms_mm"], 3) for d in jobs if d["rms_mm"]]} mm',
        file=sys.stderr,
    )
    emit('inlayer.graph_kill_arc_off_ms', late, 'ms', 'arc lease', 500.0)
    failed = sum(bool(d['error']) for d in jobs)
    emit('inlayer.cuts_failed', failed, 'jobs', 'kills', len(cut))
    wrong, beads = (sum(d.get(n, 0) for d in jobs) for n in ('wrong', 'beads'))
    emit('inlayer.cut_beads_wrong', wrong, 'beads', 'beads of these jobs', beads)


def renewal() -> None:
    from waam_adapt import answers
    from waam_adapt.laws.corrector import CorrectionParams
    from waam_msgs.msg import CorrectionMap
    from waam_msgs.srv import RenewCorrection
    from waam_node.conversions import floats, grid_to_msg

    spec, rng = GridSpec(0.0, 0.0, 0.5e-3, 140, 200), np.random.default_rng(1)
    flat = np.zeros(spec.shape)
    msg = CorrectionMap(job_id='j', layer=1, grid=grid_to_msg(spec), k_gain=0.3)
    msg.psi = msg.residual_height = msg.confidence = floats(flat)
    asked = RenewCorrection.Request(job_id='j', layer=1, correction=msg, bead_width=6e-3)
    asked.planned_height, asked.age = floats(flat + 1.5e-3), floats(flat)
    asked.ground = asked.growth = floats(1e-4 * rng.standard_normal(spec.shape))
    asked.count, took = floats(flat + 50.0), []
    for _ in range(20):
        began = time.perf_counter()
        answers.renew(CorrectionParams(), asked)
        took.append(1e3 * (time.perf_counter() - began))
    emit('inlayer.renew_ms', float(np.median(took)), 'ms', 'limit of the service', SERVICE_MS)


def bound() -> None:
    calm = jaw_jobs(seeds(SEEDS), overrides={'cell': CALM})
    name = 'inlayer.bound_rms_ratio'
    emit(name, told(name, ratios(calm, usual(), 'rms')), '', 'wanted of in-layer correction', 0.75)


def within_and_bound() -> None:
    """The bound stands beside the figure, of the same jobs."""
    within()
    bound()


def last_touch(deposits: list[Segment], spec: GridSpec) -> np.ndarray:
    """(rows, cols) number of the last segment whose bead changes a cell; -1 = none does."""
    points, numbers = [], []
    for k, s in enumerate(deposits):
        n = max(1, int(np.ceil(s.length / STEP)))
        a, b = np.array(s.start[:2]), np.array(s.end[:2])
        points.append(a + (np.arange(n) + 0.5)[:, None] / n * (b - a))
        numbers += [k] * n
    row, col = spec.cell(*np.concatenate(points).T)
    out, reach = np.full(spec.shape, -1), int(REACH / spec.resolution)
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            r, c = row + i, col + j
            ok = (np.hypot(i, j) <= reach) & (r >= 0) & (r < spec.rows)
            ok &= (c >= 0) & (c < spec.cols)
            np.maximum.at(out, (r[ok], c[ok]), np.array(numbers)[ok])
    return out


def seen_share(deposits: list[Segment], spec: GridSpec, offset: float, fan: float) -> float:
    """Share of the cells of a layer that are seen after their last bead, by the best begin of the look."""
    touched, seen = last_touch(deposits, spec), np.zeros(spec.shape, bool)
    x, y = spec.x[None], spec.y[:, None]
    best = 0.0
    for k in range(len(deposits) - 1, -1, -1):
        s = deposits[k]
        low, high = sorted((s.start[0] + offset, s.end[0] + offset))
        half = spec.resolution / 2
        seen |= (x >= low - half) & (x <= high + half) & (abs(y - s.midpoint[1]) <= fan / 2)
        best = max(best, float((seen & (touched >= 0) & (touched < k)).sum()))
    return best / max(int((touched >= 0).sum()), 1)


def in_view() -> None:
    shares = []
    with tempfile.TemporaryDirectory() as folder:
        for result in jaw_jobs(seeds((1, 2, 3)), keep=True, jobs_dir=Path(folder)):
            plan = load_plan(next(Path(result.folder).glob('plan*.npz')))
            offset, fan = plan.settings.scanner_offset[0], plan.settings.scanner_fov
            layers = [
                [s for s in layer.segments if s.kind == Kind.DEPOSIT] for layer in plan.layers
            ]
            found = [seen_share(deposits, plan.spec, offset, fan) for deposits in layers]
            print(f'seed {result.seed}:', [f'{100 * v:.1f} %' for v in found], file=sys.stderr)
            shares.append(100 * float(np.mean(found)))
    emit('inlayer.seen_pct', min(shares), '%', 'wanted by the correction server', 90.0)


REGIMES = {
    'inlayer.usual_rms_ratio': ('usual', 'rail'),
    'inlayer.usual_plate_rms_ratio': ('usual', 'plate'),
    'inlayer.spool_rms_ratio': ('spool', 'rail'),
    'inlayer.spool_plate_rms_ratio': ('spool', 'plate'),
    'inlayer.drift_rms_ratio': ('drift', 'rail'),
    'inlayer.wrong_map_rms_ratio': ('wrong_map', 'rail'),
    'inlayer.warp_rms_ratio': ('warp', 'rail'),
}
OF_PASSES = {'scan_time_ratio': 'scan_time', 'scan_rms_ratio': 'rms', 'job_time_ratio': 'time'}
PASSES = {part: partial(passes, part) for part in ('rail', 'plate')}
FIGURES = {
    **{figure: in_regime(figure, *case) for figure, case in REGIMES.items()},
    **{f'inlayer.{part}_{of}': run for part, run in PASSES.items() for of in OF_PASSES},
    'inlayer.rms_ratio': within_and_bound,
    'inlayer.within_scan_time_ratio': within_scan,
    'inlayer.within_scan_rms_ratio': within_scan,
    'inlayer.lost': replaced,
    'inlayer.doubled': replaced,
    'inlayer.kill_arc_off_ms': kills,
    'inlayer.graph_kill_arc_off_ms': graph_kills,
    'inlayer.cuts_failed': graph_kills,
    'inlayer.cut_beads_wrong': graph_kills,
    'inlayer.renew_ms': renewal,
    'inlayer.scan_time_ratio': changed_only,
    'inlayer.job_time_ratio': changed_only,
    'inlayer.scan_rms_ratio': changed_only,
    'inlayer.bound_rms_ratio': within_and_bound,
    'inlayer.seen_pct': in_view,
}
