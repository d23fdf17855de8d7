"""The standoff control in whole jobs of the laboratory: controller, bridge and job as they are, sensors and metal those
of the simulated cell.

standoff.rms_mm, standoff.rms_arc_mm: true contact distance less 15 mm, by the laser and by the arc, from 1 s after each
strike on: two layers of a block of 60 x 40 mm on a plate that rises by 3 mm under the torch, seeds 1-20. Baseline: no
tracking, same seeds.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from bench_shape import workers
from lib.preset import emit_on_cell as emit
from lib.preset import preset

SEEDS = range(1, 21)
WARPS = {'part_warp': 3.5e-3, 'part_warp_energy': 4e4}


def rms_mm(source: str) -> float:
    """With this source of the distance; 'none' = no tracking."""
    from waam_lab import parts, run_many

    overrides = {'cell': WARPS, 'bridge': {'standoff_source': source}}
    own = {'layers': 2, 'preset': preset(), 'overrides': overrides}
    with tempfile.TemporaryDirectory() as folder:
        jobs = [parts.job(Path(folder), 'block', seed, **own) for seed in SEEDS]
        found = run_many(jobs, workers=workers())
    for r in found:
        alarms = [a['text'] for a in r.anomalies if a['text'].startswith('E212')]
        if r.failed or alarms:
            text = r.message[:120] if r.failed else '; '.join(alarms)
            print(f'standoff: {source}, seed {r.seed}: {text}', file=sys.stderr)
    each = ', '.join(f'{r.contact_rms * 1e3:.3f}' for r in found)
    worst = max(r.contact_worst for r in found) * 1e3
    print(f'standoff: {source}: {each} mm; largest {worst:.2f} mm', file=sys.stderr)
    return 1e3 * float(np.sqrt(np.mean([r.contact_rms**2 for r in found])))


def warping_job() -> None:
    without = rms_mm('none')
    for name, source in (('rms_mm', 'laser'), ('rms_arc_mm', 'arc')):
        emit(f'standoff.{name}', rms_mm(source), 'mm', 'no tracking, same seeds', without)


FIGURES = {'standoff.rms_mm': warping_job, 'standoff.rms_arc_mm': warping_job}
