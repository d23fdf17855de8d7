"""The standoff control in whole jobs of the laboratory: controller, bridge and job as they are, sensors and metal those
of the simulated cell.

standoff.rms_mm, standoff.rms_arc_mm: true contact distance less 15 mm, by the laser and by the arc, from 1 s after each
strike on: two layers of a block of 60 x 40 mm on a plate that rises by 3 mm under the torch, seeds 1-20. Baseline: no
tracking, same seeds.
standoff.cell_too_close, standoff.cell_closest_mm: 60 jobs of one layer on the part that warps, by the laser with one of
six faults, the map wrong by up to 2 mm, seeds 1-10: jobs with the wire nearer than half its contact distance, and the
smallest distance of all. The fault lasts from the first strike on.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from bench_shape import workers
from lib.preset import emit_on_cell, preset

LAB_SEEDS = range(1, 21)
FAULT_SEEDS = range(1, 11)
WARPS = {'part_warp': 3.5e-3, 'part_warp_energy': 4e4}


def in_laboratory(seeds: range, source: str, cell: dict, layers: int, fault: str = '') -> list:
    """Results of the block on the plate; `cell`: parameters of the cell, or seed -> parameters."""
    from waam_lab import Fault, parts, run_many

    own = {
        'layers': layers,
        'preset': preset(),
        'faults': (Fault(fault),) if fault else (),
    }
    with tempfile.TemporaryDirectory() as folder:
        jobs = []
        for seed in seeds:
            overrides = {'cell': cell.get(seed, cell), 'bridge': {'standoff_source': source}}
            jobs.append(parts.job(Path(folder), 'block', seed, overrides=overrides, **own))
        found = run_many(jobs, workers=workers())
    for r in found:
        alarms = [a['text'] for a in r.anomalies if a['text'].startswith('E212')]
        if r.failed or (alarms and not fault):
            text = r.message[:120] if r.failed else '; '.join(alarms)
            print(f'standoff: {source}, seed {r.seed}: {text}', file=sys.stderr)
    return found


def warping_job() -> None:
    def rms(source: str) -> float:
        found = in_laboratory(LAB_SEEDS, source, WARPS, 2)
        each = ', '.join(f'{r.contact_rms * 1e3:.3f}' for r in found)
        worst = max(r.contact_worst for r in found) * 1e3
        print(f'standoff: {source}: {each} mm; largest {worst:.2f} mm', file=sys.stderr)
        return 1e3 * float(np.sqrt(np.mean([r.contact_rms**2 for r in found])))

    without = rms('none')
    for name, source in (('rms_mm', 'laser'), ('rms_arc_mm', 'arc')):
        emit_on_cell(f'standoff.{name}', rms(source), 'mm', 'no tracking, same seeds', without)


def faults_in_the_cell() -> None:
    """Every job has one fault from the first strike on, and a map that is wrong by up to 2 mm."""
    close, least = 0, math.inf
    offs = {n: float(np.random.default_rng([n, 4]).uniform(-2e-3, 0)) for n in FAULT_SEEDS}
    cell = {n: {**WARPS, 'part_moved_z': off} for n, off in offs.items()}
    for fault in ('dead', 'stuck', 'drift', 'inverted', 'unit', 'dropout'):
        found = in_laboratory(FAULT_SEEDS, 'laser', cell, 1, f'distance_{fault}')
        alarms = sum(any(a['text'].startswith('E212') for a in r.anomalies) for r in found)
        nearest = min(r.contact_least for r in found) * 1e3
        ended = sum(r.failed for r in found)
        text = f'{fault}: {len(found)} jobs, {alarms} with an alarm, closest {nearest:.2f} mm, {ended} failed'
        print(f'standoff: {text}', file=sys.stderr)
        close += sum(r.contact_least < 7.5e-3 for r in found)
        least = min(least, nearest)
    emit_on_cell('standoff.cell_too_close', close, 'jobs', 'wanted', 0.0)
    emit_on_cell('standoff.cell_closest_mm', least, 'mm', 'half the contact distance', 7.5)


FIGURES = {
    'standoff.rms_mm': warping_job,
    'standoff.rms_arc_mm': warping_job,
    'standoff.cell_too_close': faults_in_the_cell,
    'standoff.cell_closest_mm': faults_in_the_cell,
}
