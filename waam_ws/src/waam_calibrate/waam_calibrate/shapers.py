"""Input shapers: impulses, what they leave of a vibration, what they cost, and which one to take. Pure.

The shapers are those of the controller (waam_firmware/doc/input_shaping.md). Smoothing, acceleration, score and choice
follow the method of the standard firmware of 3-D printing, which source 002 uses: figures of its log come out exactly.
Frequencies Hz, times s; smoothing and acceleration in mm and mm/s^2, as the source tells them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

TYPES = ('zv', 'zvd', 'mzv', 'ei', '2hump_ei', '3hump_ei')  # in the controller: 1 to 6
DAMPING = 0.1  # of the source
TOLERANCE = 0.05  # of EI and its relatives: the vibration that is allowed at the tuned frequency
FLOOR = 1.0 / 20.0  # of the highest peak: what lies below counts as no vibration
ACCELERATION, CORNER_SPEED = 5000.0, 5.0  # mm/s^2, mm/s: for which smoothing is told
SMOOTHING = 0.12  # mm, at which the acceleration is told
DAMPING_SPREAD = (0.75, 1.0, 1.5)  # of the damping: vibration is that of the worst
LOWEST_HZ = {  # below it the controller refuses the shaper: its mean delay is beyond the lead of the wire
    'zv': 5.2, 'zvd': 9.6, 'mzv': 7.4, 'ei': 9.6, '2hump_ei': 14.0, '3hump_ei': 17.0,
}  # fmt: skip
HIGHEST_HZ, STEP_HZ = 134.0, 0.2  # of the search
UNCERTAIN = 0.15  # relative: by so much the modes may be elsewhere than where they were measured
RATIOS = np.arange(
    0.0, 32.0, 0.004
)  # frequency over the tuned one, at which what a shaper leaves is tabulated
SLACK = 0.01  # share of the vibration that is no difference


@dataclass(frozen=True)
class Impulses:
    """`amplitude` (n,) with the sum 1 at `time` (n,) s."""

    amplitude: np.ndarray
    time: np.ndarray


@dataclass(frozen=True)
class Candidate:
    """A shaper as the source's log tells it. vibration: share that remains; smoothing mm; acceleration mm/s^2;
    vibration_off: what remains when the modes are UNCERTAIN off, the worse side; None = not known."""

    type: str
    hz: float
    vibration: float
    smoothing: float
    acceleration: float
    damping: float = DAMPING
    vibration_off: float | None = None

    @property
    def score(self) -> float:
        """The lower the better; by the vibration that remains with uncertain modes, where that is known."""
        return score(self.smoothing, max(self.vibration, self.vibration_off or 0.0))


def _amplitudes(kind: str, k: float) -> tuple[Sequence[float], Sequence[float]]:
    """Amplitudes and times in damped periods; k: what half a period leaves of an oscillation."""
    v = TOLERANCE
    if kind == 'zv':
        return (1.0, k), (0.0, 0.5)
    if kind == 'zvd':
        return (1.0, 2 * k, k * k), (0.0, 0.5, 1.0)
    if kind == 'mzv':
        first, step = 1 - math.sqrt(0.5), k**0.75
        return (first, (math.sqrt(2) - 1) * step, first * step * step), (0.0, 0.375, 0.75)
    if kind == 'ei':
        return ((1 + v) / 4, (1 - v) / 2 * k, (1 + v) / 4 * k * k), (0.0, 0.5, 1.0)
    if kind == '2hump_ei':
        x = (v * v * (math.sqrt(1 - v * v) + 1)) ** (1 / 3)
        a = (3 * x * x + 2 * x + 3 * v * v) / (16 * x)
        return (a, (0.5 - a) * k, (0.5 - a) * k * k, a * k**3), (0.0, 0.5, 1.0, 1.5)
    if kind == '3hump_ei':
        a = (1 + 3 * v + 2 * math.sqrt(2 * (v + 1) * v)) / 16
        b, c = (1 - v) / 4, (1 + v) / 2 - 2 * a
        return (a, b * k, c * k * k, b * k**3, a * k**4), (0.0, 0.5, 1.0, 1.5, 2.0)
    raise ValueError(f"shaper '{kind}' is unknown; known are {', '.join(TYPES)}")


def impulses(kind: str, hz: float, damping: float = DAMPING) -> Impulses:
    """The shaper tuned to a mode of `hz` (without damping). ValueError for an unknown type."""
    damped = math.sqrt(1 - damping * damping)
    amplitude, time = _amplitudes(kind, math.exp(-damping * math.pi / damped))
    a = np.array(amplitude)
    return Impulses(a / a.sum(), np.array(time) / (hz * damped))


def residual(shaper: Impulses, hz: np.ndarray, damping: float) -> np.ndarray:
    """What the shaper leaves of the vibration of modes of `hz` (n,) with this damping, share of the unshaped (n,)."""
    omega = 2 * np.pi * np.asarray(hz, float)[..., None]
    before_end = shaper.time[-1] - shaper.time
    weight = shaper.amplitude * np.exp(-damping * omega * before_end)
    angle = omega * math.sqrt(1 - damping * damping) * before_end
    return np.hypot((weight * np.sin(angle)).sum(-1), (weight * np.cos(angle)).sum(-1))


def smoothing(shaper: Impulses, acceleration: float = ACCELERATION) -> float:
    """Offset (mm) from the path: the larger of a turn by 90 and by 180 degrees; mm/s^2."""
    off = shaper.time - float(shaper.amplitude @ shaper.time)
    late = off >= 0
    corner = shaper.amplitude * (CORNER_SPEED + 0.5 * acceleration * off) * off
    back = shaper.amplitude @ (0.5 * acceleration * off**2)
    return max(float(corner[late].sum()) * math.sqrt(2), float(back))


def acceleration_for(shaper: Impulses) -> float:
    """Highest acceleration (mm/s^2) with at most SMOOTHING of it; 0 when the corner alone takes more."""
    low, high = 0.0, 1.0
    if smoothing(shaper, low) > SMOOTHING:
        return 0.0
    while smoothing(shaper, high) <= SMOOTHING:
        low, high = high, 2 * high
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if smoothing(shaper, middle) <= SMOOTHING else (low, middle)
    return low


def score(smooth: float, vibration: float) -> float:
    """The lower the better: vibration and smoothing (mm) weighed as the method does."""
    return smooth * (vibration**1.5 + 0.2 * vibration + 0.01)


def candidate(kind: str, hz: float, vibration: float, damping: float = DAMPING) -> Candidate:
    """The log line of a shaper: smoothing as it is, acceleration rounded to 100 mm/s^2."""
    shaper = impulses(kind, hz, damping)
    acceleration = 100.0 * round(acceleration_for(shaper) / 100.0)
    return Candidate(kind, hz, vibration, smoothing(shaper), acceleration, damping)


def left(shaper: Impulses, hz: np.ndarray, psd: np.ndarray, damping: float) -> float:
    """Share of the vibration above the floor that remains; psd (n,) at hz (n,), any unit."""
    return _share(residual(shaper, hz, damping), psd)


def _share(rest: np.ndarray, psd: np.ndarray) -> float:
    """The same for the residual (n,) of every frequency."""
    floor = FLOOR * float(psd.max())
    shaped = np.maximum(rest * psd - floor, 0.0).sum()
    return float(shaped / np.maximum(psd - floor, 0.0).sum())


def best_of(kind: str, hz: np.ndarray, psd: np.ndarray, damping: float = DAMPING) -> Candidate:
    """The best frequency for one type, for modes that may be UNCERTAIN off: of those that leave at most a tenth or a
    hundredth of the whole more than the least, the one with the lowest score."""
    one = impulses(kind, 1.0, damping)
    rests = [residual(one, RATIOS, damping * spread) for spread in DAMPING_SPREAD]

    def worst(tuned: float) -> float:
        return max(_share(np.interp(hz / tuned, RATIOS, rest), psd) for rest in rests)

    found = []
    for tuned in np.arange(LOWEST_HZ[kind], HIGHEST_HZ + STEP_HZ / 2, STEP_HZ).tolist():
        off = max(worst(tuned * f) for f in (1 - UNCERTAIN, 1.0, 1 + UNCERTAIN))
        found.append((off, score(smoothing(impulses(kind, tuned, damping)), off), tuned))
    least = min(v for v, _, _ in found)
    off, _, tuned = min(
        (f for f in found if f[0] <= max(1.1 * least, least + SLACK)), key=lambda f: f[1]
    )
    best = candidate(kind, round(tuned, 1), worst(tuned), damping)
    return replace(best, vibration_off=off)


def choose(candidates: Sequence[Candidate]) -> Candidate:
    """Each one, in order, replaces the best so far where 1.2 x its score is lower."""
    best = candidates[0]
    for c in candidates[1:]:
        if 1.2 * c.score < best.score:
            best = c
    return best


def propose(hz: np.ndarray, psd: np.ndarray, damping: float = DAMPING) -> list[Candidate]:
    """The best of every type for a spectrum: psd (n,) at hz (n,). The one to take: `choose`."""
    return [best_of(kind, hz, psd, damping) for kind in TYPES]
