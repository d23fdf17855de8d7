"""Where the torch was between two rows of telemetry: on the planned line, not on the chord that cuts its corners.

Ten rows a second lie one or two millimetres apart. On chords a torch cuts corners by up to 0.4 mm, the simulated beads
come out taller than the recorded ones, and the fit takes that for a cell whose wire becomes less metal.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

MAX_OFF_LINE = 1e-3  # m beside the planned line at which a row is not on it
AHEAD = 16  # pieces of the line that the torch may pass between two rows


class Line:
    """The planned path of one layer. `a`, `b`: (n, 2) m, ends of its pieces in the order in which they are laid; the
    ways between two beads count as pieces, too."""

    def __init__(self, a: np.ndarray, b: np.ndarray) -> None:
        points = np.stack([a, b], axis=1).reshape(-1, 2)
        moved = np.hypot(*np.diff(points, axis=0).T) > 1e-9
        self.a, self.way = points[:-1][moved], np.diff(points, axis=0)[moved]
        self.length = np.hypot(*self.way.T)
        self.begin = np.concatenate([[0.0], np.cumsum(self.length)])
        self._here = 0

    def follow(self, t: np.ndarray, row_t: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Places (m, 2) m at times t (m,), of rows (n, 2) m at row_t (n,), of one arc. Arcs come in their order.

        What a row lies beside the line is kept. Where rows are not on the line, places lie on chords.
        """
        out = np.column_stack([np.interp(t, row_t, rows[:, k]) for k in (0, 1)])
        s = self._along(rows)
        on = np.flatnonzero(np.isfinite(s))
        if on.size < 3:
            return out
        s = np.maximum.accumulate(s[on])
        beside = rows[on] - self._at(s)
        inside = (t >= row_t[on[0]]) & (t <= row_t[on[-1]])
        inside &= np.isin(np.searchsorted(row_t, t, side='right') - 1, on)
        held = [np.interp(t[inside], row_t[on], beside[:, k]) for k in (0, 1)]
        way = PchipInterpolator(row_t[on], s)(t[inside])
        out[inside] = self._at(way) + np.column_stack(held)
        return out

    def _along(self, rows: np.ndarray) -> np.ndarray:
        """Length of the line up to every row (n,), m; NaN = not on it."""
        out, first = np.full(len(rows), np.nan), True
        for i, p in enumerate(rows):
            near = slice(self._here, None if first else self._here + AHEAD)
            square = np.maximum(self.length[near] ** 2, 1e-18)
            share = np.clip(((p - self.a[near]) * self.way[near]).sum(axis=1) / square, 0.0, 1.0)
            away = np.hypot(*(self.a[near] + share[:, None] * self.way[near] - p).T)
            best = int(np.argmin(away + 1e-6 * np.arange(away.size)))
            if away[best] < MAX_OFF_LINE:
                self._here += best
                out[i] = self.begin[self._here] + share[best] * self.length[self._here]
                first = False
        return out

    def _at(self, s: np.ndarray) -> np.ndarray:
        k = np.clip(np.searchsorted(self.begin, s, side='right') - 1, 0, len(self.a) - 1)
        share = (s - self.begin[k]) / np.maximum(self.length[k], 1e-12)
        return self.a[k] + np.clip(share, 0.0, 1.0)[:, None] * self.way[k]
