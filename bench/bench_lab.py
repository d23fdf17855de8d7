"""The laboratory: how fast it is on one core, and whether it says what the graph says.

lab.speed: simulated seconds per second of processor time: closed-loop jobs of the demo's jaw with scans, planning and
the job folder (baseline: the whole graph, 13 s per second of wall time on two cores, the README's figure);
lab.speed_ratio: the same over that of commit 986bae11, which knew one cell, today's `gentle`: the smaller one of the
ratios of `gentle` and `recorded`, each the median of three jobs in turn. Needs the history of git;
lab.agreement_pct: largest difference of the RMS height error between laboratory and graph, same job and same seed, over
five seeds (baseline: the graph against itself, first seed twice; its timing depends on the load).

`WAAM_BENCH_SEEDS=1,7,11` chooses the seeds; each takes the graph about a minute.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path

from lib import before
from lib.before import BEFORE
from lib.demo import demo
from lib.jaw import jaw_job
from lib.preset import emit_on_cell as emit
from lib.preset import preset
from lib.seeds import seeds

GRAPH_RATE = 13.0  # s/s, `make demo` on two cores (README.md)
SEEDS = (1, 2, 3, 7, 11)
PRESETS = ('gentle', 'recorded')
TURNS = 3


def in_laboratory(wanted: tuple[int, ...]) -> list:
    from waam_lab import over_seeds, run_many

    return run_many(over_seeds(jaw_job(), wanted), workers=1)


def speed() -> None:
    """One worker, so that nothing but this job uses its core."""
    found = in_laboratory(seeds(SEEDS))
    rate = sum(r.time for r in found) / sum(r.cpu for r in found)
    emit('lab.speed', rate, 's/s', 'the graph on two cores (README)', GRAPH_RATE)


def speed_ratio() -> None:
    """Both in turn, because what else the computer does changes what a second of its processor is worth."""
    rates: dict[str, list[float]] = {name: [] for name in (BEFORE, *PRESETS)}
    with before.tree() as environment:
        for _ in range(TURNS):
            rates[BEFORE].append(before.speed(environment))
            for name in PRESETS:
                rates[name].append(before.speed({}, preset=name))
    for name, found in rates.items():
        print(f'{name}: {", ".join(f"{r:.1f}" for r in found)} s/s', file=sys.stderr)
    middle = {name: statistics.median(found) for name, found in rates.items()}
    slower = min(middle[name] for name in PRESETS)
    emit('lab.speed_ratio', slower / middle[BEFORE], '', f'commit {BEFORE}', 1.0)


def agreement() -> None:
    """RMS of both for every seed on stderr."""
    wanted = seeds(SEEDS)
    found, graph = in_laboratory(wanted), []
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        for seed in (*wanted, wanted[0]):
            report, _ = demo(Path(scratch), seed, ('closed_loop',), preset())
            graph.append(report['closed_loop']['rms_mm'])
    for r, rms in zip(found, graph, strict=False):
        print(f'seed {r.seed}: graph {rms:.4f}, laboratory {r.rms * 1e3:.4f} mm', file=sys.stderr)
    difference = max(abs(r.rms * 1e3 / rms - 1) for r, rms in zip(found, graph, strict=False))
    itself = abs(graph[-1] / graph[0] - 1)
    emit('lab.agreement_pct', 100 * difference, '%', 'the graph against itself', 100 * itself)


FIGURES = {'lab.speed': speed, 'lab.speed_ratio': speed_ratio, 'lab.agreement_pct': agreement}
