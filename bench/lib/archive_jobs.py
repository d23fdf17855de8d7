"""Jobs for the benchmarks of the archive: folders with the files that a question needs, and large recordings."""

from __future__ import annotations

import copy
import json
import shutil
import sys
from datetime import timedelta
from pathlib import Path

import numpy as np

from lib.paths import SOURCES

sys.path.insert(0, str(SOURCES / 'waam_archive' / 'test'))
from made_jobs import FIRST  # noqa: E402
from made_record import make_record  # noqa: E402

from .preset import preset

COPIED = ('records.json', 'status.json', 'telemetry.npz', 'plan.npz')  # maps are left out


def laid(folder: Path, count: int, layers: int) -> list[Path]:
    """Folders of so many jobs of the laboratory: a block of so many layers, on cells of different seeds."""
    from waam_lab import over_seeds, parts, run_many

    job = parts.job(
        folder, 'block', layers=layers, keep=True, jobs_dir=folder / 'jobs', preset=preset()
    )
    results = run_many(over_seeds(job, list(range(1, count + 1))))
    failed = [r.message for r in results if r.failed]
    if failed:
        raise RuntimeError(f'a job of the laboratory failed: {failed[0]}')
    return [r.folder for r in results if r.folder is not None]


def many_jobs(folder: Path, patterns: list[Path], count: int, seed: int = 1) -> None:
    """So many copies of the job folders `patterns`, without maps; each has its own id, part, time and RMS."""
    rng = np.random.default_rng(seed)
    reports = [json.loads((p / 'report.json').read_text()) for p in patterns]
    for n in range(count):
        pattern, report = patterns[n % len(patterns)], reports[n % len(patterns)]
        created = FIRST + timedelta(minutes=10 * n)
        job_id = f'{created:%Y%m%dT%H%M%SZ}_part{n % 20}_{n}'
        own = {'job_id': job_id, 'created': created.isoformat(), 'part': f'part{n % 20}.stl'}
        changed = copy.deepcopy(report) | own
        run = next(changed[k] for k in ('closed_loop', 'monitor', 'open_loop') if k in changed)
        run['rms_mm'] = 0.09 + 0.01 * rng.standard_normal()
        here = folder / job_id
        here.mkdir(parents=True)
        asked = (pattern / 'job.yaml').read_text()
        (here / 'job.yaml').write_text(asked.replace(pattern.name, job_id))
        (here / 'report.json').write_text(json.dumps(changed, indent=1))
        for file in (pattern / name for name in COPIED):
            if file.exists():
                shutil.copy(file, here)


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
