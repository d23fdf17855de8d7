"""A figure over the jobs of a selection, in the order of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .archive import Archive
from .metrics import query
from .selection import Selection


class Trend(NamedTuple):
    """Jobs that have a value, oldest first: ids (n,), when they ended (n,) datetime64, UTC, NaT where that is not
    known, and the values (n,)."""

    jobs: np.ndarray
    created: np.ndarray
    values: np.ndarray


def values_of(archive: Archive, metric: str, chosen: Selection) -> Trend:
    """metric: key of METRICS."""
    where, bound = chosen.where()
    tables, asked = query(metric, where)
    found: dict[str, np.ndarray] = archive.ask(
        tables, lambda db: db.execute(asked, bound).fetchnumpy()
    )
    jobs, created, values = (found[n] for n in ('job', 'created', 'value'))
    if isinstance(created, np.ma.MaskedArray):
        created = created.filled(np.datetime64('NaT'))
    return Trend(np.asarray(jobs), created, np.asarray(values, float))
