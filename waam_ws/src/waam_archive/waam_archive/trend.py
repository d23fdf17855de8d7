"""A figure over the jobs of a selection, in the order of time."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from .archive import Archive
from .kept_figures import KeptFigures
from .metrics import query
from .selection import Selection


class Trend(NamedTuple):
    """Jobs that have a value, oldest first: ids (n,), when they ended (n,) datetime64, UTC, NaT where that is not
    known, and the values (n,)."""

    jobs: np.ndarray
    created: np.ndarray
    values: np.ndarray


_kept: WeakKeyDictionary[Archive, KeptFigures] = WeakKeyDictionary()


def kept_figures(archive: Archive) -> KeptFigures:
    """Of an archive, as long as somebody holds it."""
    return _kept.setdefault(archive, KeptFigures(archive))


def values_of(archive: Archive, metric: str, chosen: Selection) -> Trend:
    """metric: key of METRICS.

    An archive that is held open keeps a row per job in memory, as long as nothing is written into it: the first
    question reads the files, the others take some milliseconds. These rows are kept in a file as well, for the next
    program.
    """
    where, bound = chosen.where()
    asked = query(metric, where)
    found: dict[str, np.ndarray] = kept_figures(archive).ask(
        lambda db: db.execute(asked, bound).fetchnumpy()
    )
    jobs, created, values = (found[n] for n in ('job', 'created', 'value'))
    if isinstance(created, np.ma.MaskedArray):
        created = created.filled(np.datetime64('NaT'))
    return Trend(np.asarray(jobs), created, np.asarray(values, float))
