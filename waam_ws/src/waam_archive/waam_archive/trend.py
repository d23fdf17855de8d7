"""A figure over the jobs of a selection, in the order of time."""

from __future__ import annotations

import numpy as np

from .archive import Archive, Row
from .metrics import METRICS, query
from .selection import Selection


def values_of(archive: Archive, metric: str, chosen: Selection) -> tuple[list[Row], np.ndarray]:
    """Jobs (job, created, value) with a value of the metric (key of METRICS), oldest first, and the values (n,)."""
    where, bound = chosen.where()
    m = METRICS[metric]
    tables = ('jobs', 'beads') if m.of_beads else ('jobs',)
    rows = archive.rows(tables, query(m, where), bound)
    return rows, np.array([r['value'] for r in rows], float)
