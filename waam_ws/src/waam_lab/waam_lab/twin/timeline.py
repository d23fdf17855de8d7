"""From telemetry at 10 Hz to what the torch did in steps of 5 ms while the arc burned; readings of the pyrometer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .along import Line
from .records import JobRecord

STEP = 5e-3  # s
AFTER = 0.03  # s shown after the arc went out
QUIET = 1.0  # s without arc before a reading of the pyrometer counts
APART = 2.0  # s between two readings that count
HOTTEST = 500.0  # degC; beyond, the spot is beside fresh metal and tells of that alone


@dataclass(frozen=True)
class Burning:
    """Samples (n,) of one layer, m, s, m/s and W: the torch's tip, whether the arc burns, reading of the wire's wheel,
    electrical power. `bead`: number of the arc within the layer."""

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    lit: np.ndarray
    wire: np.ndarray
    power: np.ndarray


@dataclass(frozen=True)
class Readings:
    """The pyrometer without arc: t (n,) s, place (n,) m, degrees Celsius (n,)."""

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    celsius: np.ndarray


def arcs(telemetry: dict[str, np.ndarray]) -> np.ndarray:
    """(n, 2): when every arc struck and went out, s. To 10 ms where the record has `arc_changed`."""
    t, lit = telemetry['t'], telemetry['arc'] > 0.5
    changed = telemetry.get('arc_changed', np.full(len(t), np.nan))
    edges = np.flatnonzero(np.diff(lit.astype(int)) != 0) + 1
    exact = np.where(np.isfinite(changed[edges]), changed[edges], 0.5 * (t[edges - 1] + t[edges]))
    if lit[0]:
        edges, exact = np.concatenate([[0], edges]), np.concatenate([[t[0]], exact])
    if lit[-1]:
        exact = np.concatenate([exact, [t[-1]]])
    return exact.reshape(-1, 2)


def burning(record: JobRecord) -> dict[int, Burning]:
    """By layer. Places between two rows of telemetry lie on the planned line, without a plan on a straight one."""
    tm = record.telemetry
    found: dict[int, list[np.ndarray]] = {}
    on = tm['arc'] > 0.5
    power = np.where(on, tm['current'] * tm['voltage'], np.nan)
    known = np.flatnonzero(on)
    lines = {k: Line(*ends) for k, ends in record.paths.items()}
    for start, end in arcs(tm):
        row = min(int(np.searchsorted(tm['t'], start)), len(tm['t']) - 1)
        layer = int(tm['layer'][row])
        t = np.arange(start, end + AFTER, STEP)
        columns = [*_places(tm, t, lines.get(layer)), np.interp(t, tm['t'], tm['z'])]
        wire = np.interp(t, tm['t'], tm['wire_feed'])
        watts = np.interp(t, tm['t'][known], power[known])
        found.setdefault(layer, []).append(np.stack([t, *columns, t < end, wire, watts]))
    return {k: Burning(*np.concatenate(v, axis=1)) for k, v in found.items() if k > 0}


def _places(tm: dict[str, np.ndarray], t: np.ndarray, line: Line | None) -> np.ndarray:
    """(2, n): x and y at times t of one arc, m."""
    first, last = np.searchsorted(tm['t'], (t[0], t[-1]))
    rows = slice(max(int(first) - 1, 0), int(last) + 1)
    row_t, xy = tm['t'][rows], np.column_stack([tm['x'][rows], tm['y'][rows]])
    if line is not None:
        return line.follow(t, row_t, xy).T
    return np.stack([np.interp(t, row_t, xy[:, k]) for k in (0, 1)])


def readings(record: JobRecord) -> Readings:
    """What the pyrometer showed while nothing burned. The record holds a value until the next one comes, so only rows
    with a new value count. The first reading of all comes first: the part before the job."""
    tm = record.telemetry
    none = Readings(*(np.zeros(0) for _ in range(4)))
    if 'temperature' not in tm or not record.spots:
        return none
    t, celsius = tm['t'], tm['temperature']
    new = np.flatnonzero(np.diff(celsius, prepend=np.nan) != 0)
    ends = arcs(tm)
    times: list[int] = []
    for i in new[np.isfinite(celsius[new]) & (celsius[new] < HOTTEST)]:
        inside = ((ends[:, 0] <= t[i]) & (t[i] <= ends[:, 1] + QUIET)).any()
        if not inside and (not times or t[i] - t[times[-1]] >= APART):
            times.append(int(i))
    numbers = sorted(record.spots)
    layer = np.maximum.accumulate(tm['layer']).astype(int)
    places = [
        record.spots[min(numbers, key=lambda n: abs(n - max(int(layer[i]), 1)))] for i in times
    ]
    if not times:
        return none
    x, y = np.array(places).T
    return Readings(t[times], x, y, celsius[times])
