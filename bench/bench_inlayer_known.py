"""What there is to know of a layer of the demo's jaw while it is laid: the bounds of correcting within it.

known.last_layer_rms_ratio: RMS at the end of jobs whose last layer is laid without any disturbance of the metal
over that of the same jobs with it: what knowing all of it in advance is worth where no layer follows.
known.mounted_rms_ratio: of jobs in whose layers the disturbance is taken out as far as it follows from what the scanner
showed finished DELAY s before, where the cell has it. known.anywhere_rms_ratio: by a scanner that sees all
finished metal at once. known.at_once_rms_ratio: by something that sees every bead right behind the pool.
The shares of the disturbance's variance that were known so are on stderr. Baseline: jobs with all of it.
known.foretold_pct: share of the variance of a layer's growth, against the metal asked for, that its neighbours
foretell that were finished DELAY s before, wherever the scanner is; best of three spreads, one factor for all cells,
layers and seeds, fitted to the same jobs. The misfit of the bead model at turns is in it.
known.foretold_mounted_pct: the same by what the scanner of the cell passes over.

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
from lib.inlayer_known import LAST_LAYER, SPREADS, Foretold, Known, Sight, of_seed, usual
from lib.seeds import seeds

SEEDS = tuple(range(1, 21))
DELAY = 10.0  # s of path that the controller holds and keeps, at least (docs/in_layer.md)
SIGHTS = {
    'last_layer': Sight(everything=True, first=LAST_LAYER),
    'mounted': Sight(mounted=True, delay=DELAY),
    'anywhere': Sight(delay=DELAY),
    'at_once': Sight(at_once=True, delay=DELAY),
}


def over_seeds(function) -> list:
    """function(seed) of every seed, in processes of their own."""
    some = seeds(SEEDS)
    with ProcessPoolExecutor(min(workers(), len(some)), get_context('spawn')) as pool:
        return list(pool.map(function, some))


@cache
def usual_jobs() -> list[tuple[Known, list[Foretold]]]:
    return over_seeds(partial(usual, delay=DELAY))


def worth(name: str) -> None:
    from bench_inlayer import told

    figure = f'known.{name}_rms_ratio'
    found = over_seeds(partial(of_seed, SIGHTS[name]))
    pairs = [(k, plain) for k, (plain, _) in zip(found, usual_jobs(), strict=True)]
    by_layer = np.array([np.divide(a.by_layer, b.by_layer) for a, b in pairs])
    share = np.mean([k.share for k in found])
    each = ', '.join(f'{v:.3f}' for v in by_layer.mean(axis=0))
    print(f'{figure}: {share:.1%} of the disturbance known; by layer {each}', file=sys.stderr)
    emit(figure, told(figure, np.array([a.rms / b.rms for a, b in pairs])), '', 'nobody looks', 1.0)


def growth() -> None:
    """Foretold by neighbours."""
    layers = [row for _, rows in usual_jobs() for row in rows]
    for n in sorted({row.layer for row in layers}):
        some = [row for row in layers if row.layer == n]
        text = ', '.join(f'{100 * share(some, *which):.1f}' for which in WHICH)
        size = np.sqrt(sum(r.deviation for r in some) / sum(r.error for r in some))
        print(
            f'layer {n}: foretold {text} %; deviation over error, RMS: {size:.2f}', file=sys.stderr
        )
    for name, mounted in (('foretold', False), ('foretold_mounted', True)):
        best = max(share(layers, mounted, spread) for spread in SPREADS)
        emit(f'known.{name}_pct', 100 * best, '%', 'all of the deviation', 100.0)


WHICH = [(mounted, spread) for mounted in (False, True) for spread in SPREADS]


def share(layers: list[Foretold], mounted: bool, spread: float) -> float:
    """0..1 of the variance, by the best factor."""
    both, said = (sum(row.said[mounted, spread][k] for row in layers) for k in (0, 1))
    return both**2 / said / sum(row.deviation for row in layers) if said else 0.0


FIGURES = {
    **{f'known.{name}_rms_ratio': partial(worth, name) for name in SIGHTS},
    'known.foretold_pct': growth,
    'known.foretold_mounted_pct': growth,
}
