"""What there is to know of a layer while it is laid: the bounds of correcting within it. The demo's jaw.

known.mounted_pct: share of the variance of the metal's disturbance that the best of all estimators knows when the metal
is laid, from what the cell's scanner showed finished DELAY s before; mean over layers and seeds. known.anywhere_pct: by
a scanner that sees all finished metal at once. known.at_once_pct: by something that sees every bead right behind the
pool. known.no_delay_pct: the same without DELAY. Baseline: all of it.
known.foretold_pct: share of the variance of what a layer's surface is off by from its target that neighbours foretell
that were finished DELAY s before, wherever the scanner is; best of three spreads, one factor for all cells, layers and
seeds, fitted to the same jobs. The misfit of the bead model at turns is in it. known.foretold_growth_pct: of growth
from the metal asked for. known.foretold_mounted_pct: by what the scanner of the cell passes over.
known.rail_mounted_pct, known.rail_anywhere_pct, known.rail_at_once_pct, known.rail_no_delay_pct,
known.rail_foretold_pct, known.rail_foretold_growth_pct, known.rail_foretold_mounted_pct: the same of the rail of
lib/inlayer_regimes.py with three layers.
known.arc_pct, known.arc_noise_pct: share of the variance of what a layer's surface is off by that the level under the
arc tells before the metal is laid, beside what plan and setpoints tell (lib/inlayer_arc.py): as the simulated arc meets
it, and with the noise of arc sensing. Mean over layers 2 to 7.
known.last_layer_rms_ratio: RMS at the end of jobs whose last layer is laid without any disturbance over that of the
same jobs with it: what knowing all of it in advance is worth where no layer follows.

Seeds 1 to 20; `WAAM_BENCH_SEEDS`, `WAAM_BENCH_WORKERS` as in bench_inlayer.py.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context

import numpy as np
from bench_shape import workers
from lib.emit import emit
from lib.inlayer_known import SPREADS, Foretold, Sight, Usual, calm_rms, known_share, usual
from lib.seeds import seeds

SEEDS = tuple(range(1, 21))
DELAY = 10.0  # s of path that the controller holds and keeps, at least (docs/in_layer.md)
SIGHTS = {
    'mounted': Sight(mounted=True, delay=DELAY),
    'anywhere': Sight(delay=DELAY),
    'at_once': Sight(at_once=True, delay=DELAY),
    'no_delay': Sight(at_once=True),
}
FORETOLD = {
    'foretold': ('target', False),
    'foretold_growth': ('asked', False),
    'foretold_mounted': ('target', True),
}


def over_seeds(function) -> list:
    """function(seed) of every seed, in processes of their own."""
    some = seeds(SEEDS)
    with ProcessPoolExecutor(min(workers(), len(some)), get_context('spawn')) as pool:
        return list(pool.map(function, some))


@cache
def usual_jobs(part: str) -> list[Usual]:
    return over_seeds(partial(usual, delay=DELAY, part=part))


def known(part: str) -> None:
    jobs, group = usual_jobs(part), '' if part == 'jaw' else f'{part}_'
    for name, sight in SIGHTS.items():
        shares = np.array([[known_share(layer, sight) for layer in job.layers] for job in jobs])
        each = ', '.join(f'{100 * v:.1f}' for v in shares.mean(axis=0))
        print(f'{part}, {name}: by layer {each} %', file=sys.stderr)
        mean = 100 * float(shares.mean())
        emit(f'known.{group}{name}_pct', mean, '%', 'all of the disturbance', 100.0)
    layers = [row for job in jobs for row in job.foretold]
    for name, (against, mounted) in FORETOLD.items():
        of = {spread: share(layers, against, mounted, spread) for spread in SPREADS}
        each = ', '.join(f'{100 * v:.2f} % ({s} bead widths)' for s, v in of.items())
        print(f'{part}, {name}: {each}', file=sys.stderr)
        emit(f'known.{group}{name}_pct', 100 * max(of.values()), '%', 'all of it', 100.0)


def share(layers: list[Foretold], against: str, mounted: bool, spread: float) -> float:
    """0..1 of the variance, by the best factor."""
    both, said = (sum(row.said[against, mounted, spread][k] for row in layers) for k in (0, 1))
    return both**2 / said / sum(row.squares[against] for row in layers) if said else 0.0


def last_layer() -> None:
    from bench_inlayer import told

    name, calm = 'known.last_layer_rms_ratio', over_seeds(calm_rms)
    found = np.array([a / b.rms for a, b in zip(calm, usual_jobs('jaw'), strict=True)])
    emit(name, told(name, found), '', 'with its disturbance', 1.0)


def by_the_arc() -> None:
    from lib.inlayer_arc import NOISE, layers_met, news_share

    jobs = over_seeds(layers_met)
    for name, noise in (('arc', 0.0), ('arc_noise', NOISE)):
        shares = [100 * news_share(jobs, layer, noise) for layer in range(len(jobs[0]))]
        each = ', '.join(f'{v:.1f}' for v in shares)
        print(f'jaw, {name}: by layer {each} %', file=sys.stderr)
        emit(f'known.{name}_pct', float(np.mean(shares[1:])), '%', 'all of it', 100.0)


KNOWN = {part: partial(known, part) for part in ('jaw', 'rail')}
FIGURES = {
    **{f'known.{name}_pct': KNOWN['jaw'] for name in (*SIGHTS, *FORETOLD)},
    **{f'known.rail_{name}_pct': KNOWN['rail'] for name in (*SIGHTS, *FORETOLD)},
    'known.last_layer_rms_ratio': last_layer,
    'known.arc_pct': by_the_arc,
    'known.arc_noise_pct': by_the_arc,
}
