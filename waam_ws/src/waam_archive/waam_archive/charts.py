"""Control charts (Shewhart): mean and range of subgroups, or single values with their moving range; the rules of
Nelson, which name a drift before a limit is passed; the capability index Cpk. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

# factors by subgroup size (ISO 7870-2): A2 and D3, D4 of the limits, d2 = mean range over standard deviation
A2 = {2: 1.880, 3: 1.023, 4: 0.729, 5: 0.577, 6: 0.483, 7: 0.419, 8: 0.373, 9: 0.337, 10: 0.308}
D3 = {2: 0.0, 3: 0.0, 4: 0.0, 5: 0.0, 6: 0.0, 7: 0.076, 8: 0.136, 9: 0.184, 10: 0.223}
D4 = {2: 3.267, 3: 2.574, 4: 2.282, 5: 2.114, 6: 2.004, 7: 1.924, 8: 1.864, 9: 1.816, 10: 1.777}
D2 = {2: 1.128, 3: 1.693, 4: 2.059, 5: 2.326, 6: 2.534, 7: 2.704, 8: 2.847, 9: 2.970, 10: 3.078}
LARGEST_GROUP = 10


class ChartError(ValueError):
    """Too few values, or a subgroup size that there are no factors for."""


@dataclass(frozen=True)
class Signal:
    """A rule that was broken: its name, what it says, and the points (indices of subgroups) that broke it."""

    rule: str
    text: str
    points: tuple[int, ...]

    @property
    def of_ranges(self) -> bool:
        """The scatter broke it, not the mean."""
        return self.rule.startswith('range')


@dataclass(frozen=True)
class Chart:
    """group: size of the subgroups, 1 = single values. means and ranges: (k,); of single values the ranges are moving
    ones and the first is NaN. sigma: standard deviation within subgroups. left_over: values after the last whole
    subgroup, which are not on the chart. Cpk is NaN without a limit of the specification."""

    group: int
    means: np.ndarray
    ranges: np.ndarray
    center: float
    lower: float
    upper: float
    range_center: float
    range_lower: float
    range_upper: float
    sigma: float
    cpk: float
    left_over: int
    signals: list[Signal] = field(default_factory=list)


def chart(
    values: np.ndarray,
    group: int = 1,
    baseline: int = 0,
    spec: tuple[float, float] = (-math.inf, math.inf),
) -> Chart:
    """Chart of values (n,) in the order of time, finite.

    baseline: limits from so many subgroups at the beginning, 0 = from all. spec: limits of the specification for Cpk.
    Raises ChartError.
    """
    if not 1 <= group <= LARGEST_GROUP:
        raise ChartError(f'subgroups of {group}: wanted 1 to {LARGEST_GROUP}')
    if baseline < 0 or baseline == 1:
        raise ChartError(f'limits from {baseline} subgroups: wanted two or more, 0 = all')
    values = np.asarray(values, float)
    count = len(values) // group
    if count < 2:
        raise ChartError(
            f'{len(values)} values make {count} subgroups of {group}; a chart needs two'
        )
    groups = values[: count * group].reshape(count, group)
    means = groups.mean(axis=1)
    ranges = np.ptp(groups, axis=1) if group > 1 else np.abs(np.diff(means, prepend=np.nan))
    used = min(baseline, count) if baseline else count
    center, typical = float(means[:used].mean()), float(np.nanmean(ranges[:used]))
    sigma = typical / D2[max(group, 2)]
    reach = A2[group] * typical if group > 1 else 3 * sigma
    range_limits = D3[max(group, 2)] * typical, D4[max(group, 2)] * typical
    broken = signals(means, center, sigma / math.sqrt(group))
    if group > 1:
        broken += range_signals(ranges, *range_limits)
    return Chart(
        group=group, means=means, ranges=ranges, center=center, lower=center - reach, upper=center + reach,
        range_center=typical, range_lower=range_limits[0], range_upper=range_limits[1],
        sigma=sigma, cpk=cpk(center, sigma, spec), left_over=len(values) - count * group, signals=broken,
    )  # fmt: skip


def cpk(mean: float, sigma: float, spec: tuple[float, float]) -> float:
    """Distance of the mean from the nearer limit over three standard deviations; NaN without limits."""
    lower, upper = spec
    if not (math.isfinite(lower) or math.isfinite(upper)):
        return math.nan
    room = min(upper - mean, mean - lower)
    return room / (3 * sigma) if sigma > 0 else math.copysign(math.inf, room)


# ---- rules ---------------------------------------------------------------------------------------


def _windows(hit: np.ndarray, length: int, wanted: int) -> np.ndarray:
    """Ends of the windows of `length` points with `wanted` hits, the last of which is one."""
    if len(hit) < length:
        return np.empty(0, int)
    counts = np.convolve(hit.astype(int), np.ones(length, int), 'valid')
    ends = np.arange(length - 1, len(hit))
    return ends[(counts >= wanted) & hit[ends]]


def _either(z: np.ndarray, bound: float, length: int, wanted: int) -> np.ndarray:
    """Windows on one side of the center, beyond `bound` standard deviations."""
    found = [_windows(side > bound, length, wanted) for side in (z, -z)]
    return np.unique(np.concatenate(found))


def _beyond(z: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.abs(z) > 3)


def _trend(z: np.ndarray) -> np.ndarray:
    steps = np.diff(z)
    found = [_windows(np.r_[False, side > 0], 5, 5) for side in (steps, -steps)]
    return np.unique(np.concatenate(found))


def _alternating(z: np.ndarray) -> np.ndarray:
    steps = np.sign(np.diff(z))
    return _windows(np.r_[False, False, steps[1:] * steps[:-1] < 0], 12, 12)


NELSON = {
    'nelson 1': ('a point beyond three standard deviations: an outlier', _beyond),
    'nelson 2': ('nine points in a row on one side of the mean: a shift', lambda z: _either(z, 0, 9, 9)),
    'nelson 3': ('six points in a row that rise or fall: a drift', _trend),
    'nelson 4': ('fourteen points in a row that go up and down: an oscillation', _alternating),
    'nelson 5': ('two of three points beyond two on one side: a shift', lambda z: _either(z, 2, 3, 2)),
    'nelson 6': ('four of five points beyond one on one side: a small shift', lambda z: _either(z, 1, 5, 4)),
    'nelson 7': (
        'fifteen points in a row within one: layered samples, or limits too wide',
        lambda z: _windows(np.abs(z) < 1, 15, 15),
    ),
    'nelson 8': ('eight points in a row beyond one: a mixture', lambda z: _windows(np.abs(z) > 1, 8, 8)),
}  # fmt: skip


def signals(means: np.ndarray, center: float, sigma: float) -> list[Signal]:
    """Rules that the points (k,) break. sigma: of the points; 0 = all are alike, nothing is broken."""
    if not sigma > 0:
        return []
    z = (means - center) / sigma
    found = ((name, text, rule(z)) for name, (text, rule) in NELSON.items())
    return [Signal(n, t, tuple(int(i) for i in at)) for n, t, at in found if len(at)]


def range_signals(ranges: np.ndarray, lower: float, upper: float) -> list[Signal]:
    """Subgroups whose range (k,) is beyond its limits. Not for moving ranges: they share their values, so that one
    outlier would be named twice more."""
    found = (
        ('range 1', 'a range above its limit: the scatter has grown', ranges > upper),
        ('range 2', 'a range below its limit: the scatter has shrunk, or values were copied', ranges < lower),
    )  # fmt: skip
    return [Signal(n, t, tuple(map(int, np.flatnonzero(hit)))) for n, t, hit in found if hit.any()]
