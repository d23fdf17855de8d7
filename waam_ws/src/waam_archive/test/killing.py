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
    wanted = {
        t: Counter({j: n for j, n in rows.items() if j in there}) for t, rows in expected.items()
    }
    have = counted(archive)
    return found + [
        f'{t}: {have[t]} instead of {wanted[t]}' for t in TABLES if have[t] != wanted[t]
    ]


def counted(archive: Path) -> dict[str, Counter]:
    """Rows per job of every table."""
    query = ' UNION ALL '.join(
        f"SELECT '{t}' AS name, job, count(*) AS n FROM \"{t}\" GROUP BY job" for t in TABLES
    )
    found: dict[str, Counter] = {t: Counter() for t in TABLES}
    for row in Archive(archive).rows(tuple(TABLES), query):
        found[row['name']][row['job']] = row['n']
    return found
