"""A figure over the jobs of a selection, in the order of time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .archive import Archive
from .metrics import METRICS, query, table
from .selection import Selection


class Trend(NamedTuple):
    """Jobs that have a value, oldest first: ids (n,), when they ended (n,) datetime64, UTC, NaT where that is not
    known, and the values (n,)."""

    jobs: np.ndarray
    created: np.ndarray
    values: np.ndarray


def values_of(archive: Archive, metric: str, chosen: Selection) -> Trend:
    """metric: key of METRICS.

    An archive that is held open keeps a row per job in memory, as long as nothing is written into it: the first
    question reads the files, the others take some milliseconds.
    """
    where, bound = chosen.where()
    of_beads = METRICS[metric].of_beads

    def ask(db: Any) -> dict[str, np.ndarray]:
        for needed in (False, True)[: 1 + of_beads]:
            db.execute(table(needed))
        return db.execute(query(metric, where), bound).fetchnumpy()

    found = archive.ask(('jobs', 'beads'), ask)
    jobs, created, values = (found[n] for n in ('job', 'created', 'value'))
    if isinstance(created, np.ma.MaskedArray):
        created = created.filled(np.datetime64('NaT'))
    return Trend(np.asarray(jobs), created, np.asarray(values, float))
