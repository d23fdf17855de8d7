"""Bead height from profiles that were measured beside the burning arc: few points, spatter, reflections, flicker.

Every profile is split where neighbouring points jump: a surface is continuous, spatter and reflections are not. The
piece that best fits what was seen before gives the crown (a robust parabola) with its uncertainty, and a Kalman
filter of height and slope with a gate joins the crowns. All is causal, and the slope in the state leaves no lag
behind a ramp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bead import crown
from .files import InprocessScan

STEP = 0.3e-3  # m, between neighbouring points of one surface (52 degrees at the usual 0.06 mm would be 0.08)
GAP = 0.4e-3  # m, across the bead, between points of one surface
LEAST = 8  # points of a piece that can show a crown
HALF_WIDTH = 1.0e-3  # m, of the crown that is fitted
START_RATE = 10e-3  # m/s, of the bead height at the first crown
FLOOR = 20e-6  # m, uncertainty of a crown at best: ripples, speckle


@dataclass(frozen=True)
class FilterLimits:
    """Of the Kalman filter of the crown."""

    # m per s^1.5, how much the rate of height changes on its own in a second (white acceleration)
    wander: float = 5e-3
    gate: float = 4.0  # standard deviations between prediction and crown
    lost: int = 4  # profiles in a row outside the gate, after which the filter restarts


@dataclass(frozen=True)
class CrownSeries:
    """One value per profile (n,). Heights as in the file: the distance from the sensor when that is what it holds."""

    t: np.ndarray  # s
    raw: np.ndarray  # m, median of the profile
    crown: np.ndarray  # m, of the chosen piece, NaN = none
    crown_u: np.ndarray  # m, its standard uncertainty
    height: np.ndarray  # m, filtered, NaN before the first crown
    u: np.ndarray  # m, its standard uncertainty
    used: np.ndarray  # bool, the crown passed the gate


def pieces(x: np.ndarray, z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The continuous pieces of a profile (m,), NaN left out, each in the order of x; short ones are spatter."""
    good = np.isfinite(x) & np.isfinite(z)
    order = np.argsort(x[good], kind='stable')
    x, z = x[good][order], z[good][order]
    cut = np.flatnonzero((np.abs(np.diff(z)) > STEP) | (np.diff(x) > GAP)) + 1
    parts = zip(np.split(x, cut), np.split(z, cut), strict=True)
    return [(a, b) for a, b in parts if len(a) >= LEAST]


def crown_of(x: np.ndarray, z: np.ndarray, sign: float) -> tuple[float, float]:
    """Height (m) of the crown of a piece and its standard uncertainty; sign = -1 when z is a distance."""
    up = sign * z
    top = x[np.argmax(np.convolve(up, np.ones(5) / 5, 'same')[2:-2]) + 2]
    near = np.abs(x - top) <= HALF_WIDTH
    height, u = crown((x[near] - top) / HALF_WIDTH, up[near])
    return sign * height, float(np.hypot(u, FLOOR))


def filter_scan(
    scan: InprocessScan, limits: FilterLimits | None = None, distance: bool = True
) -> CrownSeries:
    """distance: z of the scan grows away from the sensor."""
    limits, sign = limits or FilterLimits(), -1.0 if distance else 1.0
    n = len(scan.t)
    crowns, crown_u, height, u = np.full((4, n), np.nan)
    used = np.zeros(n, bool)
    state = _State(limits)
    for k in range(n):
        found = [crown_of(x, z, sign) for x, z in pieces(scan.x[k], scan.z[k])]
        found = [c for c in found if np.isfinite(c[0])]
        state.predict(scan.t[k])
        if found:
            crowns[k], crown_u[k] = state.nearest(found)
            used[k] = state.update(crowns[k], crown_u[k])
        height[k], u[k] = state.value
    raw = np.array([np.nanmedian(z) if np.isfinite(z).any() else np.nan for z in scan.z])
    return CrownSeries(
        t=scan.t, raw=raw, crown=crowns, crown_u=crown_u, height=height, u=u, used=used
    )


class _State:
    """Height and its rate, known by (2,) mean and (2, 2) covariance, observed now and then."""

    def __init__(self, limits: FilterLimits) -> None:
        self._limits = limits
        self._mean, self._covariance = np.full(2, np.nan), np.eye(2)
        self._t, self._missed = np.nan, 0

    @property
    def value(self) -> tuple[float, float]:
        known = np.isfinite(self._mean[0])
        return (
            (float(self._mean[0]), float(np.sqrt(self._covariance[0, 0])))
            if known
            else (np.nan, np.nan)
        )

    def predict(self, t: float) -> None:
        dt = max(0.0, t - self._t) if np.isfinite(self._t) else 0.0
        step = np.array([[1.0, dt], [0.0, 1.0]])
        noise = self._limits.wander**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        self._mean = step @ self._mean
        self._covariance = step @ self._covariance @ step.T + noise
        self._t = t

    def nearest(self, found: list[tuple[float, float]]) -> tuple[float, float]:
        """The crown that fits the prediction best; without one, the most certain."""
        if not np.isfinite(self._mean[0]) or self._missed >= self._limits.lost:
            return min(found, key=lambda c: c[1])
        return min(found, key=lambda c: abs(c[0] - self._mean[0]))

    def update(self, crown: float, u: float) -> bool:
        if not np.isfinite(self._mean[0]) or self._missed >= self._limits.lost:
            self._mean, self._missed = np.array([crown, 0.0]), 0
            self._covariance = np.diag([u**2, START_RATE**2])
            return True
        total = self._covariance[0, 0] + u**2
        off = crown - self._mean[0]
        if off**2 > self._limits.gate**2 * total:
            self._missed += 1
            return False
        gain = self._covariance[:, 0] / total
        self._mean = self._mean + gain * off
        self._covariance = self._covariance - np.outer(gain, self._covariance[0])
        self._missed = 0
        return True


def median_filter(values: np.ndarray, width: int = 5) -> np.ndarray:
    """Running median over the last `width` values (n,), the usual filter. NaN are left out."""
    out = np.full(len(values), np.nan)
    for k in range(len(values)):
        window = values[max(0, k - width + 1) : k + 1]
        if np.isfinite(window).any():
            out[k] = np.nanmedian(window)
    return out


@dataclass(frozen=True)
class SeriesQuality:
    """How good a series of heights is."""

    spikes: int  # values further than 0.3 mm from the median of the five around them
    noise: float  # m, robust standard deviation of a single value, from second differences
    # correlation of neighbours without the running median of a second; noise pulls it to 0
    lag1: float
    delay: float  # s, by which the series lags behind the raw one
    missing: int  # NaN values


def quality(
    t: np.ndarray, values: np.ndarray, raw: np.ndarray, spike: float = 0.3e-3
) -> SeriesQuality:
    """Of a series (n,) in m at times (n,) in s; raw: the series it was made from."""
    good = np.isfinite(values)
    v, s = values[good], t[good]
    near = np.array([np.median(v[max(0, k - 2) : k + 3]) for k in range(len(v))])
    slow = np.array([np.median(v[np.abs(s - a) <= 0.5]) for a in s])
    second = np.diff(v, 2)
    noise = 1.4826 * float(np.median(np.abs(second - np.median(second)))) / np.sqrt(6)
    rest = v - slow
    a, b = rest[:-1], rest[1:]
    lag1 = float(np.corrcoef(a, b)[0, 1]) if len(a) > 2 and a.std() * b.std() > 0 else float('nan')
    spikes = int((np.abs(v - near) > spike).sum())
    return SeriesQuality(spikes, noise, lag1, delay_of(t, values, raw), int((~good).sum()))


def delay_of(t: np.ndarray, values: np.ndarray, raw: np.ndarray, most: float = 0.15) -> float:
    """Shift (s) by which `values` (n,) follow `raw` (n,): the one with the least mean absolute difference of rates."""
    step = 5e-3
    grid = np.arange(t[0] + most, t[-1] - most, step)
    both = [np.isfinite(a) for a in (values, raw)]
    shifts = np.arange(-most, most, step)
    follow = np.diff(np.interp(grid, t[both[0]], values[both[0]]), 1)
    cost = []
    for d in shifts:
        lead = np.diff(np.interp(grid - d, t[both[1]], raw[both[1]]), 1)
        cost.append(np.mean(np.minimum(np.abs(lead - follow), 0.1e-3)))
    return float(shifts[int(np.argmin(cost))])
