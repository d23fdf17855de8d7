"""First arcs of a commissioning: the arc by its telemetry, beads by the maps before and after them. Pure. SI, but what
is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec
from waam_process.materials import Material

from .commission import Check, Outcome, judged
from .evidence import EvidenceError

SETTLED = 1.0  # s after the arc has struck
SHARE_LIT = 0.98  # of the time from strike to end
STRIKE_S = 2.0
CURRENT = (0.6, 1.5)  # of the set current of the table
ANY_CURRENT_A = (40.0, 400.0)  # where the table has none
VOLTS, WIRE = 3.0, (0.9, 1.1)  # read less asked; read over asked
EFFICIENCY, MEAN = (
    (0.65, 1.3),
    (0.75, 1.1),
)  # metal of a bead over that of its wire, and of all: beads scatter
SIZE = (0.6, 1.6)  # width and height over those of the table
FOOT = 0.1  # of the crown: where a section ends
REACH = 0.012  # m to both sides of a bead that belong to it


@dataclass(frozen=True)
class ArcRecord:
    """Frames (n,) of a job, SI. enabled, lit: the arc as commanded and as established."""

    time: np.ndarray
    enabled: np.ndarray
    lit: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    wire: np.ndarray
    wire_commanded: np.ndarray


def arc(r: ArcRecord, feed: float, voltage: float, material: Material) -> Outcome:
    """A first bead with one feed (m/s) and voltage. EvidenceError when no arc is in the record."""
    lit = np.flatnonzero(r.lit)
    if not len(lit):
        raise EvidenceError('no arc is in the record')
    asked = np.flatnonzero(r.enabled)
    first, last = lit[0], lit[-1]
    steady = r.lit & (r.time > r.time[first] + SETTLED) & (r.wire_commanded > 0.9 * feed)
    if steady.sum() < 50:
        raise EvidenceError(f'the arc burns steadily for {steady.sum()} frames only')
    between = r.lit[first : last + 1]
    set_current = material.set_current(feed)
    low, high = (c * set_current for c in CURRENT) if set_current else ANY_CURRENT_A
    current, volts, wire = (float(np.mean(v[steady])) for v in (r.current, r.voltage, r.wire))
    checks = (
        Check('strike', float(r.time[first] - r.time[asked[0]]) if len(asked) else np.nan, 0.0, STRIKE_S, 's'),
        Check('arc stays', 100 * float(np.mean(between)), 100 * SHARE_LIT, 100.0, '%'),
        Check('current', current, low, high, 'A'),
        Check('voltage read less asked', volts - voltage, -VOLTS, VOLTS, 'V'),
        Check('wire read over asked', wire / feed, *WIRE),
    )  # fmt: skip
    text = f'{current:.0f} A, {volts:.1f} V of {voltage:g}, {60 * wire:.2f} m/min of wire'
    mend = 'gas, earth clamp, contact tip, polarity; scales of the source (by hand); stick-out'
    return judged(checks, text, mend)


@dataclass(frozen=True)
class Bead:
    """A piece of a bead along x between two places (m), at y, with its regime (SI)."""

    name: str
    x: tuple[float, float]
    y: float
    feed: float
    speed: float
    voltage: float


@dataclass(frozen=True)
class Section:
    """Mean section of a piece: area m2, height and width m."""

    area: float
    height: float
    width: float


def section(bead: Bead, spec: GridSpec, before: np.ndarray, after: np.ndarray) -> Section:
    """From the maps (rows, cols), m. EvidenceError where they do not show it."""
    along = (spec.x > bead.x[0]) & (spec.x < bead.x[1])
    across = np.abs(spec.y - bead.y) < REACH
    growth = (after - before)[np.ix_(across, along)]
    seen = np.isfinite(growth)
    if growth.size == 0 or seen.mean() < 0.8:
        raise EvidenceError(f'bead {bead.name}: the maps do not show it')
    profile = np.nanmean(growth, axis=1)
    crown = float(np.nanmax(profile))
    if not crown > 0.2e-3:
        raise EvidenceError(f'bead {bead.name}: nothing grew there ({1e3 * crown:.2f} mm)')
    bead_there = profile > FOOT * crown
    area = float(np.nansum(profile[bead_there])) * spec.resolution
    return Section(area, crown, float(bead_there.sum()) * spec.resolution)


def mean_of(sections: Sequence[Section]) -> Section:
    """Of pieces with the same regime."""
    return Section(
        *(float(np.mean([getattr(s, n) for s in sections])) for n in ('area', 'height', 'width'))
    )


def beads(found: Sequence[tuple[Bead, Section]], material: Material) -> Outcome:
    """Sections against the table of the material."""
    checks: list[Check] = []
    shares = []
    for bead, seen in found:
        wire = material.wire_area * bead.feed / bead.speed
        width = material.width(bead.feed, bead.speed, bead.voltage)
        height = material.efficiency * wire / (AREA_FACTOR * width)
        shares.append(seen.area / wire)
        low, high = SIZE
        checks += [
            Check(f'{bead.name}: efficiency', shares[-1], *EFFICIENCY),
            Check(f'{bead.name}: width', 1e3 * seen.width, 1e3 * low * width, 1e3 * high * width, 'mm'),
            Check(f'{bead.name}: height', 1e3 * seen.height, 1e3 * low * height, 1e3 * high * height, 'mm'),
        ]  # fmt: skip
    mean = float(np.mean(shares))
    checks.append(Check('mean efficiency', mean, *MEAN))
    text = (
        f'{100 * mean:.0f} % of the wire becomes bead in {len(found)} regimes, the table says '
        f'{100 * material.efficiency:.0f} %; the table is not fitted: jobs learn their own'
    )
    return judged(
        checks, text, 'wire diameter and material of the cell file, wheel, stick-out, gas'
    )
