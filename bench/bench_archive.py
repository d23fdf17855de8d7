"""The archive of jobs: how fast a recording is taken in and a trend over many jobs answered, and what kills do.

archive.ingest_mb_per_s: an MCAP recording becomes a job, MB of the file per second (baseline: reading the recording
alone, every message, in the same run; 120 s of job, 180 MB, the median of five);
archive.query_ms: p99 of a trend over 10^4 jobs with 10^6 beads, of figures of the beads, asked by a program that holds
the archive open (baseline: the mean current from reports and telemetry of the folders); archive.query_jobs_ms: the same
of figures of the jobs (baseline: the RMS from the reports). Each figure is asked twenty times; baselines are medians of
three, times jobs per folder.
archive.query_first_ms: the first question of a program to an archive that somebody has asked since it was
written (p99 of ten; baseline as of archive.query_ms); archive.query_changed_ms: to one that has taken in a job since;
archive.query_cold_ms: to one that nobody has ever asked, when all files are read. The jobs are three of the laboratory,
copied with an id, a time and an RMS of their own: 500 as folders that are taken in, the others as rows that go through
the archive's own writer, because ten thousand folders take minutes to make;
archive.lost: SIGKILL at 200 random moments of an ingest: jobs that were lost (no longer whole, or not there after the
next ingest), and jobs that were there twice, together (baseline: 0, which is asked for).

WAAM_BENCH_ARCHIVE_JOBS (10000), WAAM_BENCH_ARCHIVE_FOLDERS of them (500), WAAM_BENCH_ARCHIVE_KILLS (200)
change them.
"""

from __future__ import annotations

import json
import os
import random
import shutil
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
KILLS = int(os.environ.get('WAAM_BENCH_ARCHIVE_KILLS', '200'))
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


def one_more(place: Path, jobs: Path, number: int) -> None:
    """Takes one more job into the archive."""
    from lib.archive_jobs import without_folders

    from waam_archive.archive import Archive
    from waam_archive.ingest import read, sources

    (made,) = without_folders([read(next(iter(sources(jobs))))], 1, 100 + number)
    made.job = f'more{number}'
    made.rows = {t: [row | {'job': made.job} for row in rows] for t, rows in made.rows.items()}
    with Archive(place).store.writing() as writer:
        writer.add([made])
        writer.merge()


def query_time() -> None:
    from waam_archive.archive import Archive
    from waam_archive.metrics import METRICS
    from waam_archive.selection import Selection
    from waam_archive.trend import values_of

    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        jobs = Path(scratch) / 'jobs'
        place = jobs / 'archive'
        filled(place, jobs)
        took: dict[str, list[float]] = {name: [] for name in ASKED}
        opened: dict[str, list[float]] = {'cold': [], 'first': [], 'changed': []}
        for n, m in enumerate(ASKED * 2):
            shutil.rmtree(place / '.figures', ignore_errors=True)
            for kind, times in opened.items():
                if kind == 'changed':
                    one_more(place, jobs, n)
                times.append(timed(lambda m=m: values_of(Archive(place), m, Selection())))
        for name, times in opened.items():
            said = f'opened and asked, {name}: median {np.median(times) * 1e3:.0f} ms'
            print(said, file=sys.stderr)
        held = Archive(place)
        for name in ASKED:
            values_of(held, name, Selection())
            for _ in range(QUESTIONS // len(ASKED)):
                took[name].append(timed(lambda m=name: values_of(held, m, Selection())))
        plain = {
            q: [timed(lambda q=q: q(jobs)) for _ in range(3)]
            for q in (from_reports, from_telemetry)
        }
    slow = {q: float(np.median(t)) * 1e3 * JOBS / FOLDERS for q, t in plain.items()}
    for name, times in took.items():
        folders = slow[from_telemetry if METRICS[name].of_beads else from_reports]
        p50, last = np.median(times) * 1e3, max(times) * 1e3
        print(
            f'{name}: p50 {p50:.1f} ms, max {last:.1f} ms; from folders {folders:.0f} ms, {folders / p50:.0f} times',
            file=sys.stderr,
        )
    said = f'the same from {FOLDERS} job folders, scaled to {JOBS}'
    for figure, of_beads, source in (
        ('archive.query_ms', True, from_telemetry),
        ('archive.query_jobs_ms', False, from_reports),
    ):
        mine = [
            t for name, times in took.items() if METRICS[name].of_beads == of_beads for t in times
        ]
        emit(figure, float(np.quantile(mine, 0.99)) * 1e3, 'ms', said, slow[source])
    for figure, times in opened.items():
        p99 = float(np.quantile(times, 0.99)) * 1e3
        emit(f'archive.query_{figure}_ms', p99, 'ms', said, slow[from_telemetry])


def lost() -> None:
    import lib.archive_jobs  # noqa: F401 - puts the folder of the next two on the path

    from waam_archive.archive import Archive
    from waam_archive.ingest import ingest

    from killing import counted, ingest_in_child, troubles  # isort: skip
    from made_jobs import make_job  # isort: skip

    rng = random.Random(seeds((1,))[0])
    with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
        jobs = Path(scratch) / 'jobs'
        for n in range(1, 7):
            make_job(jobs, n, layers=1)
        spent = timed(lambda: ingest_in_child(Path(scratch) / 'whole', jobs, 60.0))
        expected, wrong, killed = counted(Path(scratch) / 'whole'), 0, 0
        for n in range(KILLS):
            place = Path(scratch) / f'a{n}'
            killed += ingest_in_child(place, jobs, rng.uniform(0.0, spent))
            found = troubles(place, expected)
            ingest(Archive(place).store, [jobs])
            found += ['lost or doubled'] * (counted(place) != expected)
            for line in found:
                print(f'kill {n}: {line}', file=sys.stderr)
            wrong += bool(found)
        print(f'{killed} of {KILLS} were killed before their end', file=sys.stderr)
    emit('archive.lost', wrong, 'kills with a job lost or doubled', 'asked for', 0)


FIGURES = {
    'archive.ingest_mb_per_s': ingest_rate,
    'archive.query_ms': query_time,
    'archive.query_jobs_ms': query_time,
    'archive.query_first_ms': query_time,
    'archive.query_changed_ms': query_time,
    'archive.query_cold_ms': query_time,
    'archive.lost': lost,
}
