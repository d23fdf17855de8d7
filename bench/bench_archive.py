"""The archive of jobs: how fast a recording is taken in and a trend over many jobs answered.

archive.ingest_mb_per_s: an MCAP recording becomes a job, MB of the file per second (baseline: reading the recording
alone, every message, in the same run; 120 s of job, 180 MB, the median of five);
archive.query_ms: p99 of a trend over 10^4 jobs with 10^6 beads, of figures of the beads, asked by a program that holds
the archive open (baseline: the mean current from reports and telemetry of the folders); archive.query_jobs_ms: the same
of figures of the jobs (baseline: the RMS from the reports). Each figure is asked twenty times; baselines are medians of
three, times jobs per folder. The jobs are three of the laboratory, copied with an id, a time and an RMS of their own:
500 as folders that are taken in, the others as rows that go through the archive's own writer, because ten thousand
folders take minutes to make.

WAAM_BENCH_ARCHIVE_JOBS (10000), WAAM_BENCH_ARCHIVE_FOLDERS of them (500) change them.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from lib.emit import emit
from lib.seeds import seeds

JOBS = int(os.environ.get('WAAM_BENCH_ARCHIVE_JOBS', '10000'))
FOLDERS = min(JOBS, int(os.environ.get('WAAM_BENCH_ARCHIVE_FOLDERS', '500')))
LAYERS = 9  # of a job of the laboratory: 108 beads
ASKED = ('rms', 'deposition', 'strikes', 'current', 'bead_energy')
QUESTIONS = 100


def timed(action: Callable[[], Any]) -> float:
    """s of wall time."""
    started = time.perf_counter()
    action()
    return time.perf_counter() - started


def ingest_rate() -> None:
    from lib.archive_jobs import recording

    from waam_archive.archive import Archive
    from waam_archive.ingest import ingest
    from waam_record.bag_reader import bag_files
    from waam_record.salvage import records

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        record = recording(Path(scratch) / 'record', 120, 20_000)
        files = bag_files(record)
        size = sum(f.stat().st_size for f in files) / 1e6
        read, taken = [], []
        for n in range(5):
            read.append(timed(lambda: [sum(1 for _ in records(f)) for f in files]))
            place = Archive(Path(scratch) / f'archive{n}')
            taken.append(timed(lambda place=place: ingest(place.store, [record])))
        alone, whole = size / float(np.median(read)), size / float(np.median(taken))
        print(f'{size:.0f} MB, ingest {taken} s, reading {read} s', file=sys.stderr)
    emit('archive.ingest_mb_per_s', whole, 'MB/s', 'reading the MCAP alone', alone)


def from_reports(jobs: Path) -> list[tuple[str, float]]:
    """The RMS trend as somebody without an archive reads it: from every report."""
    found = []
    for file in jobs.glob('*/report.json'):
        report = json.loads(file.read_text())
        run = next(report[p] for p in ('closed_loop', 'monitor', 'open_loop') if p in report)
        found.append((report['created'], run['rms_mm']))
    return sorted(found)


def from_telemetry(jobs: Path) -> list[tuple[str, float]]:
    """The trend of the mean current, likewise: from every report and telemetry."""
    found = []
    for file in jobs.glob('*/telemetry.npz'):
        created = json.loads((file.parent / 'report.json').read_text())['created']
        with np.load(file) as track:
            found.append((created, float(track['current'][track['arc'] > 0].mean())))
    return sorted(found)


def filled(place: Path, jobs: Path) -> None:
    """An archive of JOBS jobs; FOLDERS of them are folders."""
    from lib.archive_jobs import laid, many_jobs, without_folders

    from waam_archive.archive import Archive
    from waam_archive.ingest import ingest, read, sources

    seed = seeds((1,))[0]
    many_jobs(jobs, laid(jobs.parent / 'laboratory', 3, LAYERS), FOLDERS, seed)
    store = Archive(place).store
    spent = timed(lambda: ingest(store, [jobs]))
    pattern = [read(s) for s in list(sources(jobs))[:50]]
    more = without_folders(pattern, JOBS - FOLDERS, seed)
    with store.writing() as writer:
        for first in range(0, len(more), 16):
            writer.add(more[first : first + 16])
            writer.merge()
    beads = Archive(place).rows(('beads',), 'SELECT count(*) AS n FROM beads')[0]['n']
    print(f'{FOLDERS} folders taken in within {spent:.0f} s; {beads} beads', file=sys.stderr)


def query_time() -> None:
    from waam_archive.archive import Archive
    from waam_archive.metrics import METRICS
    from waam_archive.selection import Selection
    from waam_archive.trend import values_of

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        jobs = Path(scratch) / 'jobs'
        filled(jobs / 'archive', jobs)
        held, took = Archive(jobs / 'archive'), {}
        for name in ASKED:
            values_of(held, name, Selection())
            asked = range(QUESTIONS // len(ASKED))
            took[name] = [timed(lambda m=name: values_of(held, m, Selection())) for _ in asked]
        plain = {
            of_beads: float(np.median([timed(lambda q=q: q(jobs)) for _ in range(3)]))
            for of_beads, q in ((True, from_telemetry), (False, from_reports))
        }
    said = f'the same from {FOLDERS} job folders, scaled to {JOBS}'
    for figure, of_beads in (('archive.query_ms', True), ('archive.query_jobs_ms', False)):
        mine = np.concatenate([t for n, t in took.items() if METRICS[n].of_beads == of_beads])
        folders = plain[of_beads] * 1e3 * JOBS / FOLDERS
        emit(figure, float(np.quantile(mine, 0.99)) * 1e3, 'ms', said, folders)


FIGURES = {
    'archive.ingest_mb_per_s': ingest_rate,
    'archive.query_ms': query_time,
    'archive.query_jobs_ms': query_time,
}
