"""Figures of an arc log while the arc burns steadily: means, scatter within a second, drift, correlation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

AFTER_STRIKE, BEFORE_END = 0.6, 0.25  # s that do not count
LONGEST_GAP = 1.0  # s between two rows of one arc
MIN_ARC_TIME = 2.0  # s of an arc that counts
FEED = 0.110  # m/s, of a log that does not say
OPEN_VOLTS = 45.0  # V; above there is no arc
BLOCKS = 8  # for standard errors
NAMES = ('current', 'fast_current', 'slow_current', 'fast_voltage', 'slow_voltage', 'slope', 'rest', 'correlation',
         'slow_correlation', 'drift_time')  # fmt: skip


@dataclass(frozen=True)
class Steady:
    """Rows (n,) of steady arcs: t s; wire m/s (reading); current A; voltage V; run: number of the arc."""

    t: np.ndarray
    wire: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    run: np.ndarray

    held: float = 0.0  # share of rows that only repeated the reading before; they are left out
    fed: bool = True  # whether the log has the wire feed; otherwise it is taken as constant

    @property
    def longest(self) -> float:
        """Of its arcs, s."""
        return max((float(np.ptp(self.t[self.run == k])) for k in np.unique(self.run)), default=0.0)

    @property
    def seconds(self) -> float:
        """Time with a steady arc."""
        return float(sum(np.ptp(self.t[self.run == k]) for k in np.unique(self.run)))


def steady(t: np.ndarray, columns: Mapping[str, np.ndarray]) -> Steady:
    """From telemetry (see `read`); rows without current or voltage are left out, and those
    without wire feed, unless no row has one."""
    wire, current, voltage = (columns[k] for k in ('wire_feed_speed', 'arc_current', 'arc_voltage'))
    fed = bool(np.isfinite(wire).any())
    wire = wire if fed else np.full(t.size, FEED)
    known = np.isfinite(wire) & np.isfinite(current) & np.isfinite(voltage)
    lit = (columns['arc_established'] > 0.5) & (current > 10.0) & (voltage < OPEN_VOLTS)
    cut = (~lit[1:]) | (~lit[:-1]) | (np.diff(t) > LONGEST_GAP)
    group = np.concatenate([[0], np.cumsum(cut)]) if t.size else np.empty(0, int)
    use, run, number = np.zeros(t.size, bool), np.zeros(t.size, int), 0
    for k in np.unique(group[lit]) if t.size else ():
        at = np.flatnonzero((group == k) & lit)
        if t[at[-1]] - t[at[0]] < MIN_ARC_TIME:
            continue
        inside = at[(t[at] > t[at[0]] + AFTER_STRIKE) & (t[at] < t[at[-1]] - BEFORE_END)]
        use[inside], run[inside] = True, number
        number += 1
    use &= known
    feed = _feed(t[use], wire[use], run[use])
    return _fresh(Steady(t[use], feed, current[use], voltage[use], run[use], fed=fed))


def _feed(t: np.ndarray, wire: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Wire feed without what its wheel misses for a moment: medians over a second."""
    out = wire.copy()
    for k in np.unique(run):
        at = run == k
        step = float(np.median(np.diff(t[at]))) if at.sum() > 2 else 1.0
        size = min(max(int(round(1.0 / max(step, 1e-3))), 1), max(int(at.sum()), 1)) | 1
        out[at] = median_filter(wire[at], size, mode='nearest')
    return out


def _fresh(seen: Steady) -> Steady:
    """Logs are often faster than the source tells its readings: rows that repeat the one before are left out."""
    same = (np.diff(seen.current) == 0) & (np.diff(seen.voltage) == 0) & (np.diff(seen.run) == 0)
    new = np.concatenate([[True], ~same]) if seen.t.size else np.empty(0, bool)
    held = 1.0 - float(new.mean()) if new.size else 0.0
    return replace(_part(seen, np.flatnonzero(new)), held=held, fed=seen.fed)


def seconds_of(seen: Steady) -> np.ndarray:
    """(n,) number of the second that each row lies in; seconds of two arcs differ."""
    whole = np.floor(seen.t - (seen.t[0] if seen.t.size else 0.0)).astype(int)
    return np.unique(np.stack([seen.run, whole]), axis=1, return_inverse=True)[1].reshape(-1)


def figures(seen: Steady) -> dict[str, float]:
    """NAMES -> value. slope: fall of the current per volt within a second, A/V; rest: scatter of the current that does
    not go with the voltage, A; drift_time: time in which the autocorrelation of means over a second falls to 1/e, s."""
    second = seconds_of(seen)
    count = np.bincount(second)
    slow = [np.bincount(second, v) / count for v in (seen.current, seen.voltage)]
    fast_i, fast_v = (
        v - s[second] for v, s in zip((seen.current, seen.voltage), slow, strict=True)
    )
    full = count >= 0.5 * np.median(count)
    slow_i, slow_v = (s[full] - s[full].mean() for s in slow)
    loss = np.sqrt(
        count.sum() / max(count.sum() - count.size, 1)
    )  # of the means that were taken out
    square = max(float(fast_v @ fast_v), 1e-12)
    slope = -float(fast_i @ fast_v) / square
    return {
        'current': float(seen.current.mean()),
        'fast_current': float(fast_i.std() * loss),
        'slow_current': float(slow_i.std()),
        'fast_voltage': float(fast_v.std() * loss),
        'slow_voltage': float(slow_v.std()),
        'slope': slope,
        'rest': float((fast_i + slope * fast_v).std() * loss),
        'correlation': _correlation(seen.current, seen.voltage),
        'slow_correlation': _correlation(slow_i, slow_v),
        'drift_time': _drift_time(slow_i),
    }


def errors(seen: Steady) -> dict[str, float]:
    """Relative standard errors of the figures, from the scatter between pieces of the recording."""
    parts = np.array_split(np.arange(seen.t.size), int(np.clip(seen.t.size // 20, 2, BLOCKS)))
    found = [figures(_part(seen, p)) for p in parts if p.size >= 10]
    out = {}
    for name in NAMES:
        values = np.array([f[name] for f in found])
        middle = abs(float(values.mean())) if values.size else 0.0
        spread = float(values.std(ddof=1)) if values.size > 1 else math.inf
        out[name] = spread / math.sqrt(max(values.size, 1)) / max(middle, 1e-9)
    few = math.sqrt(
        figures(seen)['drift_time'] / max(seen.seconds, 1.0)
    )  # of drifts that the log holds
    for name in ('slow_current', 'slow_voltage'):
        out[name] = max(out[name], few)
    out['drift_time'] = max(out['drift_time'], 2.0 * few)
    return out


def _part(seen: Steady, at: np.ndarray) -> Steady:
    return Steady(seen.t[at], seen.wire[at], seen.current[at], seen.voltage[at], seen.run[at])


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if a.size < 3 or a.std() * b.std() <= 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def _drift_time(slow: np.ndarray) -> float:
    """From lags of whole seconds; 0.5 s when neighbours are not correlated."""
    square = float(slow @ slow)
    if slow.size < 8 or square <= 0:
        return 0.5
    before = 1.0
    for lag in range(1, slow.size // 2):
        now = float(slow[lag:] @ slow[:-lag]) / square
        if now < math.exp(-1):
            share = (before - math.exp(-1)) / max(before - now, 1e-9)
            return max(lag - 1 + share, 0.5)
        before = now
    return float(slow.size // 2)
