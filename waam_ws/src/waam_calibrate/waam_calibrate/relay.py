"""Arc regulator by relay experiment: ultimate gain and period, and the plant behind them. Pure. V, s.

A relay of +-d around the working point makes the arc voltage swing (Astrom, Hagglund 1984). Its period is the ultimate
one Tu, and Ku the first harmonic of the relay, 4 d / pi sin(pi share), over that of the voltage. The plant is gain
e^(-delay s) / (lag s + 1) as in source 000, by least squares on the whole record. Swings alone tell gain over lag only;
so the record begins at rest, and the relay's setpoint lies off the working point.
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
OVER_NOISE = 2.0  # amplitude of the swing over the noise of a reading
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
    out, volts = swing.output, swing.voltage
    begin = _rest(out)
    high, low = (float(np.percentile(out[begin:], p)) for p in (90, 10))
    amplitude = 0.5 * (high - low)
    near = np.minimum(np.abs(out - high), np.abs(out - low))[begin:]
    if np.mean(near > 0.2 * amplitude) > 0.1:
        raise EvidenceError('the output has more than two levels: this is no relay experiment')
    rises = begin + _rises(out[begin:] - 0.5 * (high + low), amplitude)
    periods = np.diff(swing.time[rises])[SETTLE:]
    _check_periods(periods, step)
    tu = float(periods.mean())
    if begin * step < tu:
        text = f'{1e3 * begin * step:.0f} ms before the relay begins'
        raise EvidenceError(f'{text}, {1e3 * tu:.0f} ms at least: they tell the working point')
    first, last = int(rises[SETTLE]), int(rises[-1])
    own, noise = _harmonic(swing, tu, first, last), _noise(volts[first:last])
    if own < OVER_NOISE * noise:
        raise EvidenceError(
            f'the arc swings by {own:.2f} V, its noise is {noise:.2f} V: a larger relay is needed'
        )
    ku = (
        4
        * amplitude
        / (math.pi * own)
        * math.sin(math.pi * _share(out[first:last] > 0.5 * (high + low)))
    )
    plant, modelled, misfit = _fit(swing, begin, tu, last, noise)
    picture = Swing(swing.time[first:last], out[first:last], volts[first:last])
    return Relay(ku, tu, len(periods), misfit, plant, picture, modelled[first:last])


def _rest(output: np.ndarray) -> int:
    """Samples before the relay begins."""
    span = float(np.ptp(output))
    if not span > 0:
        raise EvidenceError('the output never changes: this is no relay experiment')
    return int(np.argmax(np.abs(output - output[0]) > 0.1 * span))


def _rises(output: np.ndarray, amplitude: float) -> np.ndarray:
    """Samples where the relay goes up; its chatter on noise counts once."""
    power = np.abs(np.fft.rfft(output - output.mean()))
    period = len(output) / max(1, int(np.argmax(power)))
    width = max(1, round(period / 8))
    smooth = np.convolve(output, np.ones(width) / width, mode='same')
    side = np.where(smooth > 0.3 * amplitude, 1, np.where(smooth < -0.3 * amplitude, -1, 0))
    known = np.flatnonzero(side)
    return known[np.flatnonzero(np.diff(side[known]) > 0) + 1]


def _share(high: np.ndarray) -> float:
    """Of the time that the relay is up; the first harmonic of its output goes with the sine of it."""
    return float(np.clip(high.mean(), 0.05, 0.95))


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
    swing: Swing, begin: int, tu: float, last: int, noise: float
) -> tuple[Plant, np.ndarray, float]:
    """The plant, the voltage that it makes of the output (n,), and the share of the swing that it leaves."""
    step = float(np.median(np.diff(swing.time)))
    level = float(swing.voltage[:begin].mean())
    out, v = (swing.output - swing.output[:begin].mean())[:last], (swing.voltage - level)[:last]

    def modelled(p: np.ndarray) -> np.ndarray:
        return simulate(Plant(*np.exp(p).tolist()), out, step)

    start = [0.0, math.log(tu), math.log(tu / 5)]
    bounds = (
        [-4.6, math.log(step), math.log(0.01 * tu)],
        [4.6, math.log(50 * tu), math.log(0.5 * tu)],
    )
    found = least_squares(lambda p: modelled(p) - v, start, bounds=bounds)
    rest = math.sqrt(max(float(np.mean(found.fun**2)) - noise**2, 0.0))
    misfit = rest / float(np.std(modelled(found.x)[begin:]))
    if misfit > MISFIT:
        text = f'a gain, a lag and a delay leave {100 * misfit:.0f} % of the swing'
        raise EvidenceError(f'{text}, at most {100 * MISFIT:g} %: did the arc burn all the time?')
    return Plant(*np.exp(found.x).tolist()), modelled(found.x) + level, misfit
