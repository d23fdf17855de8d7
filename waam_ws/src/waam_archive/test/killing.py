"""Ends an ingest with SIGKILL at any moment and looks at what it left."""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from pathlib import Path

from waam_archive import ingest as ingesting
from waam_archive import store as storing
from waam_archive.archive import Archive
from waam_archive.schema import TABLES
from waam_archive.verify import verify


def ingest_in_child(
    archive: Path, jobs: Path, kill_after: float, batch: int = 1, fan: int = 3
) -> bool:
    """Takes in the jobs in a process of its own, in small steps with many merges. True: it was killed."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            ingesting.BATCH_JOBS, storing.FAN = batch, fan
            ingesting.ingest(Archive(archive).store, [jobs])
            code = 0
        finally:
            os._exit(code)
    end = time.monotonic() + kill_after
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert status == 0, 'the ingest failed by itself'
            return False
        time.sleep(0.0005)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return status != 0


def troubles(archive: Path, expected: dict[str, Counter]) -> list[str]:
    """What is wrong: jobs that are there in part, twice, or in files that are not whole. expected: table -> rows per
    job."""
    if not Archive(archive).store.exists:
        return []
    found = list(verify(Archive(archive).store).problems)
    there = set(Archive(archive).store.catalog().home)
    for table in TABLES:
        query = f'SELECT job, count(*) AS n FROM "{table}" GROUP BY job'
        rows = {r['job']: r['n'] for r in Archive(archive).rows((table,), query)}
        wanted = {j: n for j, n in expected[table].items() if j in there}
        found += [f'{table}: {rows} instead of {wanted}'] if rows != wanted else []
    return found


def counted(archive: Path) -> dict[str, Counter]:
    """Rows per job of every table."""
    return {
        table: Counter(
            {
                r['job']: r['n']
                for r in Archive(archive).rows(
                    (table,), f'SELECT job, count(*) AS n FROM "{table}" GROUP BY job'
                )
            }
        )
        for table in TABLES
    }
