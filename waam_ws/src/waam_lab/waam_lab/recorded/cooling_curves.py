"""Pieces of a temperature record in which a place cools after the arc has passed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RISE = 30.0  # K that a pass of the arc lifts the place at least
WITHIN = 60.0  # s before the peak in which it does
MIN_COOLING = 15.0  # s of cooling that are needed
FIRST = 5.0  # s after the peak; sooner it is melt, spatter, light of the arc
FLOOR_SHARE = 0.03  # of all readings at the lowest value: the instrument reads no lower
ABOVE_FLOOR = 5.0  # K
MAX_CURVES = 40  # curves that are used


@dataclass(frozen=True)
class Curve:
    """t: (n,) s after the peak; celsius: (n,); period: s between this peak and the one before (NaN: the first)."""

    t: np.ndarray
    celsius: np.ndarray
    period: float


def curves(t: np.ndarray, celsius: np.ndarray) -> tuple[list[Curve], list[str]]:
    """Cooling curves of a record (n,) s, (n,) degrees Celsius, and what was left out."""
    notes = []
    floor = float(celsius.min()) if celsius.size else 0.0
    varies = celsius.size > 0 and float(celsius.max()) > floor + RISE
    if varies and float((celsius <= floor + 1e-6).mean()) > FLOOR_SHARE:
        notes.append(f'the instrument reads nothing below {floor:.0f} degC')
        good = celsius > floor + ABOVE_FLOOR
    else:
        good = np.ones(celsius.size, bool)
    peaks = _peaks(t, celsius)
    found, short = [], 0
    for k, i in enumerate(peaks):
        end = peaks[k + 1] if k + 1 < len(peaks) else t.size
        j = i + _cooling(t[i:end], celsius[i:end], good[i:end])
        if t[j - 1] - t[i] < MIN_COOLING or (t[i:j] - t[i] >= FIRST).sum() < 6:
            short += 1
            continue
        before = float(t[i] - t[peaks[k - 1]]) if k else float('nan')
        found.append(Curve(t[i:j] - t[i], celsius[i:j], before))
    if short:
        notes.append(
            f'{short} of {len(peaks)} peaks are followed by less than {MIN_COOLING:.0f} s of cooling'
        )
    if len(found) > MAX_CURVES:
        notes.append(f'{MAX_CURVES} of {len(found)} cooling curves are used, evenly')
        found = [found[k] for k in np.linspace(0, len(found) - 1, MAX_CURVES).astype(int)]
    return found, notes


def _peaks(t: np.ndarray, celsius: np.ndarray) -> list[int]:
    """Tops of rises of at least RISE within WITHIN seconds; of tops closer than half of MIN_COOLING the highest."""
    found: list[int] = []
    low = 0
    high = -1
    for k in range(1, t.size):
        if high < 0:
            if celsius[k] < celsius[low] or t[k] - t[low] > WITHIN:
                low = k if celsius[k] < celsius[low] else k - 1
            if celsius[k] - celsius[low] >= RISE:
                high = k
        elif celsius[k] > celsius[high]:
            high = k
        elif celsius[k] < celsius[high] - 0.3 * RISE:
            if found and t[high] - t[found[-1]] < 0.5 * MIN_COOLING:
                found[-1] = max(found[-1], high, key=lambda i: float(celsius[i]))
            else:
                found.append(high)
            low, high = k, -1
    return found


def _cooling(t: np.ndarray, celsius: np.ndarray, good: np.ndarray) -> int:
    """Rows from the peak on in which it only cools (5 K of noise allowed), above the floor, without a gap."""
    lowest = celsius[0]
    for k in range(1, t.size):
        if not good[k] or celsius[k] > lowest + 5.0 or t[k] - t[k - 1] > 5.0:
            return k
        lowest = min(lowest, celsius[k])
    return t.size
