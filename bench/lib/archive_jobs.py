"""Jobs for the benchmarks of the archive: folders with the files that a question needs, and large recordings."""

from __future__ import annotations

import copy
import json
import sys
from datetime import timedelta
from pathlib import Path

import numpy as np

from lib.paths import SOURCES

sys.path.insert(0, str(SOURCES / 'waam_archive' / 'test'))
from made_jobs import FIRST, make_job  # noqa: E402
from made_record import make_record  # noqa: E402


def many_jobs(folder: Path, count: int, beads: int, seed: int = 1) -> None:
    """Job folders with job.yaml, report.json, status.json and a telemetry of `beads` beads in two layers; no maps.

    One job is made by the job's own code; the others are that one with another id, time and RMS.
    """
    rng = np.random.default_rng(seed)
    pattern = make_job(folder, 0, beads=beads // 2, arrays=True)
    asked = (pattern / 'job.yaml').read_text()
    report = json.loads((pattern / 'report.json').read_text())
    track, plan = ((pattern / n).read_bytes() for n in ('telemetry.npz', 'plan.npz'))
    for n in range(1, count):
        created = FIRST + timedelta(minutes=10 * n)
        job_id = f'{created:%Y%m%dT%H%M%SZ}_part{n % 20}_{n}'
        changed = copy.deepcopy(report)
        changed |= {'job_id': job_id, 'created': created.isoformat(), 'part': f'part{n % 20}.stl'}
        changed['closed_loop']['rms_mm'] = 0.09 + 0.01 * rng.standard_normal()
        here = folder / job_id
        here.mkdir()
        (here / 'job.yaml').write_text(asked.replace(pattern.name, job_id))
        (here / 'report.json').write_text(json.dumps(changed, indent=1))
        (here / 'status.json').write_text('{"state": "DONE"}')
        (here / 'telemetry.npz').write_bytes(track)
        (here / 'plan.npz').write_bytes(plan)


def without_folders(contents: list, count: int, seed: int = 1) -> list:
    """So many jobs more as the archive takes them (`Content`), like those that were read from folders; no telemetry."""
    rng = np.random.default_rng(seed + 1)
    made = []
    for n in range(count):
        old = contents[n % len(contents)]
        job = f'{old.job}_again{n}'
        rows = {t: [row | {'job': job} for row in old.rows[t]] for t in old.rows}
        when = FIRST + timedelta(minutes=10 * (len(contents) + n))
        own = {'created': when.replace(tzinfo=None), 'rms_mm': 0.09 + 0.01 * rng.standard_normal()}
        rows['jobs'] = [row | own for row in rows['jobs']]
        current = rng.normal(180.0, 3.0, len(rows['beads']))
        rows['beads'] = [
            row | {'current_A': float(a)} for row, a in zip(rows['beads'], current, strict=True)
        ]
        made.append(type(old)(job, f'{old.sha256}-{n}', f'{old.source}-{n}', old.stamp, rows))
    return made


def recording(folder: Path, seconds: int, points: int) -> Path:
    """A recording with telemetry at 100 Hz and ten batches of so many profile points per second."""
    return make_record(folder, seconds=seconds, profiles=points)
