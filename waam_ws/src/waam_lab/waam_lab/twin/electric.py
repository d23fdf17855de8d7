"""Parameters of the arc from current and voltage while it burns steadily."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from waam_sim.arc import ArcParams, steady_current
from waam_sim.compiled import jit, record

from .replay import Laid, Replay
from .timeline import arcs
from .unknowns import ELECTRIC

AFTER_STRIKE, BEFORE_END = 0.6, 0.25  # s
FEWEST = 40  # rows
SLOPE, READ = (
    0.665,
    1.41,
)  # of current against voltage in telemetry, found on six cells whose parameters were known
AGAIN = 1.4  # neighbouring rows are not independent, and contact distances are computed: errors grow by this


@dataclass(frozen=True)
class Steady:
    """Rows (n,) of telemetry while the arc burns steadily: wire m/s (reading), contact distance m, current A,
    voltage V; `run`: number of the arc."""

    wire: np.ndarray
    contact: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    run: np.ndarray

    @classmethod
    def join(cls, parts: list[Steady]) -> Steady:
        """Rows of all; the arcs are counted through."""
        first = np.cumsum([0, *(int(p.run.max(initial=-1)) + 1 for p in parts[:-1])])
        runs = [p.run + n for p, n in zip(parts, first, strict=True)]
        wire, contact, amps, volts = (
            np.concatenate([getattr(p, c) for p in parts])
            for c in ('wire', 'contact', 'current', 'voltage')
        )
        return cls(wire, contact, amps, volts, np.concatenate(runs))


def steady(replay: Replay, laid: Laid) -> Steady:
    """Of a recorded job; contact distances are those of the job laid anew."""
    tm = replay.record.telemetry
    rows, runs = [], []
    for number, (start, end) in enumerate(arcs(tm)):
        inside = np.flatnonzero((tm['t'] > start + AFTER_STRIKE) & (tm['t'] < end - BEFORE_END))
        rows.append(inside)
        runs.append(np.full(inside.size, number))
    at, run = np.concatenate(rows), np.concatenate(runs)
    t = np.concatenate([replay.layers[k].t for k in sorted(laid.contact)])
    contact = np.concatenate([laid.contact[k] for k in sorted(laid.contact)])
    return Steady(
        tm['wire_feed'][at],
        np.interp(tm['t'][at], t, contact),
        tm['current'][at],
        tm['voltage'][at],
        run,
    )


def current(p: ArcParams, wire: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """A, (n,). wire: the true one, m/s; contact: m."""
    return _currents(record(p)[0], np.asarray(wire, float), np.asarray(contact, float))


@jit
def _currents(p, wire, contact):  # type: ignore[no-untyped-def]
    out = np.empty(wire.size)
    for i in range(wire.size):
        out[i] = steady_current(p, wire[i], contact[i])
    return out


@dataclass(frozen=True)
class Electric:
    """Standard values of ELECTRIC with their covariance; misfit of the current before and after, A."""

    u: np.ndarray
    covariance: np.ndarray
    before: float
    after: float


def fit_current(seen: Steady, base: ArcParams) -> Electric | None:
    """Least squares with what was believed before; None when there are too few rows."""
    if seen.wire.size < FEWEST:
        return None
    wire = seen.wire * base.wire_ratio

    def off(u: np.ndarray) -> np.ndarray:
        values = {k.field: float(k.value(v)) for k, v in zip(ELECTRIC, u, strict=True)}
        return seen.current - current(_with(base, values), wire, seen.contact)

    own = np.array([k.standard(getattr(base, k.field)) for k in ELECTRIC])
    usual = own if np.all(np.abs(own) < 4) else np.zeros(len(ELECTRIC))
    before = off(usual)
    sigma = max(_spread(before), 0.5)
    for _ in range(2):  # the scatter about the solution is what counts
        scale = sigma * AGAIN
        found = least_squares(
            lambda u, s=scale: np.concatenate([off(u) / s, u]), usual, loss='soft_l1', f_scale=3.0
        )
        sigma = max(_spread(off(found.x)), 0.5)
    slopes = np.stack(
        [(off(found.x + d) - off(found.x - d)) / 0.2 for d in 0.1 * np.eye(len(ELECTRIC))], axis=1
    )
    precision = slopes.T @ slopes / (sigma * AGAIN) ** 2 + np.eye(len(ELECTRIC))
    own = off(np.array([k.standard(getattr(base, k.field)) for k in ELECTRIC]))
    return Electric(found.x, np.linalg.inv(precision), _rms(own), _rms(off(found.x)))


def scatter(seen: Steady, p: ArcParams) -> dict[str, tuple[float, float]]:
    """length_noise (V) and current_noise (A/V) of an arc whose mean current is known, with their relative standard
    errors. The first is the scatter of the voltage within a second, less what the current drops in the cables. Of the
    current's own scatter only the part that goes with the voltage counts; the rest has other reasons."""
    if seen.wire.size < FEWEST:
        return {}
    amps = _quick(seen.current - current(p, seen.wire * p.wire_ratio, seen.contact), seen.run)
    volts = _quick(seen.voltage, seen.run) + p.resistance * amps
    near = (np.abs(volts) < 5 * volts.std()) & (np.abs(amps) < 5 * amps.std())
    found = {'length_noise': _length(volts[np.abs(volts) < 5 * volts.std()])}
    slope, error = _slope(amps[near], volts[near])
    read = (
        0.1 * p.sensor_noise / found['length_noise'][0]
    ) ** 2  # noise of the voltmeter flattens the slope
    seen_share = SLOPE / (1.0 + READ * read)
    if slope > 3 * error:
        found['current_noise'] = slope / seen_share, error / slope
    return found


def _length(volts: np.ndarray) -> tuple[float, float]:
    return float(volts.std()), 1.3 * float(np.sqrt(0.5 / len(volts)))


def _slope(amps: np.ndarray, volts: np.ndarray) -> tuple[float, float]:
    """Fall of the current per volt, with its standard error, A/V."""
    amps, volts = amps - amps.mean(), volts - volts.mean()
    square = max(float(volts @ volts), 1e-12)
    slope = -float(amps @ volts) / square
    return slope, float(np.sqrt(np.var(amps + slope * volts) / square))


def _quick(values: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Without what changes over a second."""
    out = np.zeros_like(values)
    for k in np.unique(run):
        one = values[run == k]
        out[run == k] = one - (
            median_filter(one, 21, mode='nearest') if one.size > 5 else np.median(one)
        )
    return out


def _with(base: ArcParams, values: dict[str, float]) -> ArcParams:
    return replace(base, **values)


def _spread(values: np.ndarray) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
