"""The wire wheel: how much wire one count of the encoder is, and whether it tells underfeed from normal feed. Pure. mm
and s, as on the wheel's sheet.

Source 002, 3.7: a wheel on the wire, feed below 0.9 of the desired one is underfeed. One turn is pi times the diameter
(35 mm: 109.96 mm; the source prints 88.91), one slot a part of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .evidence import EvidenceError
from .lead import WireRecord

THRESHOLD = 0.9  # of the source
FAULT_TIME = 0.5  # s below the threshold until the controller stops
MIN_MEASURED = 3
MIN_WIRE = 300.0  # mm of wire
SURE = 5e-3  # standard uncertainty of the counts per mm
WHEEL_OFF = 0.15  # counts against the geometry of the wheel
MARGIN = 4.0  # standard deviations of normal feed above the threshold
MIN_WINDOWS = 10
SETTLED = 0.03  # change of the command within a window that still is steady feed


@dataclass(frozen=True)
class Wheel:
    """diameter (mm) of the wheel where the wire runs, counts of the encoder per turn."""

    diameter: float
    counts: int

    @property
    def per_turn(self) -> float:
        """mm of wire"""
        return math.pi * self.diameter

    @property
    def per_count(self) -> float:
        """mm of wire"""
        return self.per_turn / self.counts


@dataclass(frozen=True)
class Feed:
    """Normal feed of a record in windows of FAULT_TIME: measured over commanded (n,), their mean and scatter."""

    ratios: np.ndarray

    @property
    def mean(self) -> float:
        """measured over commanded"""
        return float(self.ratios.mean())

    @property
    def sigma(self) -> float:
        """of one window"""
        return float(self.ratios.std(ddof=1))


@dataclass(frozen=True)
class WireWheel:
    """per_mm: counts per mm as measured, sigma its relative standard uncertainty; by_wheel: as the wheel's geometry
    says; lengths, counts: the measurements; resolution: share of FAULT_TIME's feed that one count is at the slowest
    feed; threshold: of underfeed; feed: normal feed of a record, None without one."""

    per_mm: float
    sigma: float
    by_wheel: float
    lengths: np.ndarray
    counts: np.ndarray
    resolution: float
    threshold: float
    feed: Feed | None


def calibrate(
    wheel: Wheel,
    lengths: Sequence[float],
    counts: Sequence[float],
    slowest: float,
    threshold: float = THRESHOLD,
    feed: Feed | None = None,
) -> WireWheel:
    """lengths (n,) mm of wire that were fed and measured with a rule, counts (n,) of the encoder; slowest: feed in mm/s
    at which underfeed must still be seen. EvidenceError."""
    _check_wheel(wheel, slowest, threshold)
    x, y = np.asarray(lengths, float), np.asarray(counts, float)
    if len(x) != len(y):
        raise EvidenceError(f'{len(x)} lengths and {len(y)} counts: one for each')
    if len(x) < MIN_MEASURED:
        raise EvidenceError(f'length: {len(x)} given, at least {MIN_MEASURED} are needed')
    if not (np.isfinite(x).all() and np.isfinite(y).all() and (x > 0).all() and (y > 0).all()):
        raise EvidenceError('lengths and counts must be numbers above 0')
    if x.min() < MIN_WIRE:
        raise EvidenceError(f'{x.min():g} mm of wire are too short: {MIN_WIRE:g} mm at least')
    each = y / x
    per_mm = float(y.sum() / x.sum())
    sigma = float(each.std(ddof=1)) / math.sqrt(len(x)) / per_mm
    if sigma > SURE:
        text = f'the counts per mm scatter: {100 * sigma:.2f} % standard uncertainty'
        raise EvidenceError(f'{text}, at most {100 * SURE:g} %: does the wheel slip?')
    by_wheel = 1 / wheel.per_count
    if abs(per_mm / by_wheel - 1) > WHEEL_OFF:
        text = f'{per_mm:.4g} counts per mm measured, {by_wheel:.4g} by the wheel'
        raise EvidenceError(f'{text}: wrong diameter, wrong counts per turn, or it slips')
    resolution = 1 / (per_mm * slowest * FAULT_TIME)
    if resolution > 1 - threshold:
        need = 1 / (1 - threshold)
        text = f'at {slowest:g} mm/s the encoder counts {1 / resolution:.1f} in {FAULT_TIME:g} s'
        raise EvidenceError(
            f'{text}; to tell {threshold:g} from 1 it needs {need:.0f}: more counts per turn or a smaller wheel'
        )
    if feed is not None:
        _check_feed(feed, threshold)
    return WireWheel(per_mm, sigma, by_wheel, x, y, resolution, threshold, feed)


def _check_wheel(wheel: Wheel, slowest: float, threshold: float) -> None:
    if not 5.0 <= wheel.diameter <= 200.0:
        raise EvidenceError(f'a wheel of {wheel.diameter:g} mm: 5 to 200 mm')
    if not 4 <= wheel.counts <= 100_000:
        raise EvidenceError(f'{wheel.counts} counts per turn: 4 to 100000')
    if not 1.0 <= slowest <= 500.0:
        raise EvidenceError(f'a feed of {slowest:g} mm/s: 1 to 500 mm/s')
    if not 0.5 <= threshold <= 0.98:
        raise EvidenceError(f'a threshold of {threshold:g}: 0.5 to 0.98 of the desired feed')


def _check_feed(feed: Feed, threshold: float) -> None:
    lowest = feed.mean - MARGIN * feed.sigma
    if lowest < threshold:
        text = f'normal feed is {feed.mean:.3f} +- {feed.sigma:.3f} of the command'
        raise EvidenceError(
            f'{text}: a threshold of {threshold:g} would stop jobs without underfeed; at most {lowest:.2f}'
        )


def normal_feed(record: WireRecord) -> Feed:
    """Steady feed of a record. EvidenceError when there is not enough of it."""
    ratios = []
    first, end = 0, len(record.time)
    while first < end:
        last = int(np.searchsorted(record.time, record.time[first] + FAULT_TIME))
        if last >= end:
            break
        told, lit = record.commanded[first:last], record.burns[first:last]
        if (
            len(told) >= 10
            and lit.all()
            and told.min() > 0
            and np.ptp(told) < SETTLED * told.mean()
        ):
            ratios.append(float(record.measured[first:last].mean() / told.mean()))
        first = last
    if len(ratios) < MIN_WINDOWS:
        text = f'{len(ratios)} windows of {FAULT_TIME:g} s with steady feed in the record'
        raise EvidenceError(f'{text}, {MIN_WINDOWS} at least')
    return Feed(np.array(ratios))
