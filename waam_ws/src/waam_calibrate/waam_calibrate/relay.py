"""Arc regulator by relay experiment: ultimate gain and period, and the plant behind them. Pure. V, s.

A relay of +-d around the working point makes the arc voltage swing (Astrom, Hagglund 1984). Its period is the ultimate
one Tu, and Ku = 4 d / (pi a) with a the amplitude of the swing. The plant is gain e^(-delay s) / (lag s + 1) as in
source 000, by least squares on the whole record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from .evidence import EvidenceError
from .regulator import Gains, Plant, Swing, simulate, ziegler_nichols

LEAST_PERIODS = 5
SAMPLES_PER_PERIOD = 20
ALIKE = 0.1  # scatter of the periods, of their mean
OVER_NOISE = 3.0  # amplitude of the swing over the noise
MISFIT = 0.35  # rms of what the plant leaves over that of the swing
SETTLE = 2  # periods at the begin that do not count


@dataclass(frozen=True)
class Relay:
    """What an experiment shows. ku, tu: ultimate gain (V/V) and period (s); periods: used; misfit: share of the swing
    that the plant leaves; swing and modelled (n,): what was compared."""

    ku: float
    tu: float
    periods: int
    misfit: float
    plant: Plant
    swing: Swing
    modelled: np.ndarray

    @property
    def ziegler_nichols(self) -> Gains:
        """From the experiment alone."""
        return ziegler_nichols(self.ku, self.tu)


def analyse(swing: Swing) -> Relay:
    """EvidenceError when the record is no relay experiment, or does not show the plant."""
    step = _check(swing)
    out, level = swing.output, float(np.median(swing.voltage))
    high, low = float(np.percentile(out, 95)), float(np.percentile(out, 5))
    amplitude = 0.5 * (high - low)
    if not amplitude > 0:
        raise EvidenceError('the output never changes: this is no relay experiment')
    middle = 0.5 * (high + low)
    near = np.minimum(np.abs(out - high), np.abs(out - low))
    if np.mean(near > 0.2 * amplitude) > 0.1:
        raise EvidenceError('the output has more than two levels: this is no relay experiment')
    rises = np.flatnonzero(np.diff((out > middle).astype(int)) == 1)
    periods = np.diff(swing.time[rises])[SETTLE:]
    _check_periods(periods, step)
    tu = float(periods.mean())
    first, last = rises[SETTLE], rises[-1]
    own = _harmonic(swing, tu, first, last)
    noise = _noise(swing.voltage[first:last])
    if own < OVER_NOISE * noise / math.sqrt(0.5 * (last - first)) or own < 0.5 * noise:
        raise EvidenceError(
            f'the arc swings by {own:.2f} V, its noise is {noise:.2f} V: a larger relay is needed'
        )
    ku = 4 * amplitude / (math.pi * own)
    plant, modelled, misfit = _fit(swing, middle, level, tu, first, last, noise)
    picture = Swing(swing.time[first:last], out[first:last], swing.voltage[first:last])
    return Relay(ku, tu, len(periods), misfit, plant, picture, modelled)


def _check(swing: Swing) -> float:
    n = len(swing.time)
    if n < 100 or len(swing.output) != n or len(swing.voltage) != n:
        raise EvidenceError(f'{n} samples: time, output and voltage for each, 100 at least')
    if not all(np.isfinite(v).all() for v in (swing.time, swing.output, swing.voltage)):
        raise EvidenceError('a sample is not a finite number')
    between = np.diff(swing.time)
    step = float(np.median(between))
    if not (step > 0 and np.allclose(between, step, rtol=0.2)):
        raise EvidenceError('the samples are not evenly spaced in time')
    return step


def _check_periods(periods: np.ndarray, step: float) -> None:
    if len(periods) < LEAST_PERIODS:
        raise EvidenceError(
            f'{max(len(periods), 0)} whole periods after the first {SETTLE}, {LEAST_PERIODS} at least'
        )
    mean, scatter = float(periods.mean()), float(periods.std())
    if mean < SAMPLES_PER_PERIOD * step:
        text = f'{mean / step:.0f} samples per period, {SAMPLES_PER_PERIOD} at least'
        raise EvidenceError(f'{text}: record faster')
    if scatter > ALIKE * mean:
        text = f'the periods scatter by {100 * scatter / mean:.0f} %, at most {100 * ALIKE:g} %'
        raise EvidenceError(f'{text}: a larger relay, or more hysteresis against the noise')


def _harmonic(swing: Swing, tu: float, first: int, last: int) -> float:
    """Amplitude (V) of the first harmonic of the voltage."""
    t = swing.time[first:last]
    v = swing.voltage[first:last] - swing.voltage[first:last].mean()
    turn = np.exp(-2j * math.pi * t / tu)
    return float(2 * abs((v * turn).mean()))


def _noise(voltage: np.ndarray) -> float:
    """V, standard deviation from sample to sample; a swing that is slow beside the samples does not count."""
    return float(np.std(np.diff(voltage, n=2)) / math.sqrt(6))


def _fit(
    swing: Swing, middle: float, level: float, tu: float, first: int, last: int, noise: float
) -> tuple[Plant, np.ndarray, float]:
    step = float(np.median(np.diff(swing.time)))
    out, v = swing.output - middle, swing.voltage - level

    def modelled(p: np.ndarray) -> np.ndarray:
        plant = Plant(math.exp(p[0]), math.exp(p[1]), math.exp(p[2]))
        return (simulate(plant, out, step) + p[3])[first:last]

    start = [0.0, math.log(tu), math.log(tu / 5), 0.0]
    bounds = (
        [-4.6, math.log(step), math.log(0.01 * tu), -20.0],
        [4.6, math.log(50 * tu), math.log(0.5 * tu), 20.0],
    )
    found = least_squares(lambda p: modelled(p) - v[first:last], start, bounds=bounds)
    rest = math.sqrt(max(float(np.mean(found.fun**2)) - noise**2, 0.0))
    misfit = rest / float(np.std(modelled(found.x)))
    if misfit > MISFIT:
        text = f'a gain, a lag and a delay leave {100 * misfit:.0f} % of the swing'
        raise EvidenceError(f'{text}, at most {100 * MISFIT:g} %: did the arc burn all the time?')
    gain, lag, delay = (math.exp(v) for v in found.x[:3])
    return Plant(gain, lag, delay), modelled(found.x) + level, misfit
