"""The archive of jobs: how fast a trend over many jobs is answered.

archive.query_ms: p99 of a trend over 10^4 jobs with 10^6 beads, of figures of the beads, asked by a program that holds
the archive open (baseline: the mean current from reports and telemetry of three folders, times jobs per folder). Each
figure is asked twenty times. Three jobs of the laboratory are taken in; the others are their rows with an id, a time
and an RMS of their own, which go through the archive's own writer.

WAAM_BENCH_ARCHIVE_JOBS (10000) changes their number.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from lib.emit import emit
from lib.preset import preset

JOBS = int(os.environ.get('WAAM_BENCH_ARCHIVE_JOBS', '10000'))
FOLDERS, LAYERS = 3, 9  # of a job: 108 beads
ASKED = ('current', 'bead_energy')
QUESTIONS = 20


def timed(action: Callable[[], Any]) -> float:
    """ms of wall time."""
    started = time.perf_counter()
    action()
    return 1e3 * (time.perf_counter() - started)


def from_telemetry(jobs: Path) -> list[tuple[str, float]]:
    """The trend of the mean current as somebody without an archive reads it: from every report and telemetry."""
    found = []
    for file in jobs.glob('*/telemetry.npz'):
        created = json.loads((file.parent / 'report.json').read_text())['created']
        with np.load(file) as track:
            found.append((created, float(track['current'][track['arc'] > 0].mean())))
    return sorted(found)


def again(old: Any, number: int, rng: np.random.Generator) -> Any:
    """A job that the archive has read (`Content`) as another one."""
    job = f'{old.job}_again{number}'
    rows = {table: [row | {'job': job} for row in found] for table, found in old.rows.items()}
    when = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=10 * number)
    own = {'created': when.replace(tzinfo=None), 'rms_mm': 0.09 + 0.01 * rng.standard_normal()}
    rows['jobs'] = [row | own for row in rows['jobs']]
    for row in rows['beads']:
        row['current_A'] = float(rng.normal(180.0, 3.0))
    return type(old)(job, f'{old.sha256}-{number}', f'{old.source}-{number}', old.stamp, rows)


def filled(scratch: Path) -> Any:
    """An archive of JOBS jobs, FOLDERS of which are folders in scratch/jobs."""
    from waam_archive.archive import Archive
    from waam_archive.ingest import ingest, read, sources
    from waam_lab import over_seeds, parts, run_many

    jobs, rng = scratch / 'jobs', np.random.default_rng(1)
    job = parts.job(scratch, 'block', layers=LAYERS, keep=True, jobs_dir=jobs, preset=preset())
    for result in run_many(over_seeds(job, range(1, FOLDERS + 1))):
        if result.failed:
            raise RuntimeError(f'a job of the laboratory failed: {result.message}')
    store = Archive(scratch / 'archive').store
    ingest(store, [jobs])
    pattern = [read(s) for s in sources(jobs)]
    with store.writing() as writer:
        for first in range(0, JOBS - FOLDERS, 16):
            numbers = range(first, min(first + 16, JOBS - FOLDERS))
            writer.add([again(pattern[n % FOLDERS], n, rng) for n in numbers])
            writer.merge()
    return Archive(scratch / 'archive')


def query_time() -> None:
    """Figures of beads, with what the folders alone would take."""
    from waam_archive.selection import Selection
    from waam_archive.trend import values_of

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        archive, took = filled(Path(scratch)), []
        for name in ASKED * QUESTIONS:
            took.append(timed(lambda m=name: values_of(archive, m, Selection())))
        plain = timed(lambda: from_telemetry(Path(scratch) / 'jobs'))
    said = f'the same from {FOLDERS} job folders, scaled to {JOBS}'
    p99 = float(np.quantile(took[len(ASKED) :], 0.99))  # the first ones open it
    emit('archive.query_ms', p99, 'ms', said, plain * JOBS / FOLDERS)


FIGURES = {'archive.query_ms': query_time}
