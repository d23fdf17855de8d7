"""One job as the archive takes it: rows of the tables, and the arrays that they are made of."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .schema import TABLES

Row = dict[str, Any]  # column -> value; a column that is missing is NULL


@dataclass
class Surface:
    """Maps of one scan. arrays: (rows, cols) by name; origin and resolution in m."""

    layer: int
    origin: tuple[float, float]
    resolution: float
    arrays: dict[str, np.ndarray] = field(default_factory=dict)


@dataclass
class Content:
    """All of one job. job: its id; stamp: names, sizes and times of its files, by which an unchanged job is known
    without reading it; notes: what could not be read, in words."""

    job: str
    sha256: str
    source: str
    stamp: str = ''
    rows: dict[str, list[Row]] = field(default_factory=lambda: {t: [] for t in TABLES})
    telemetry: dict[str, np.ndarray] = field(default_factory=dict)
    surfaces: list[Surface] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def has_report(self) -> bool:
        """A job that was cut off has none."""
        return bool(self.rows['jobs'] and self.rows['jobs'][0].get('has_report'))

    @property
    def size(self) -> int:
        """Bytes of the arrays."""
        maps = sum(a.nbytes for s in self.surfaces for a in s.arrays.values())
        return maps + sum(a.nbytes for a in self.telemetry.values())
