"""From samples of an accelerometer to the modes of an axis and the shaper for it. Pure. Frequencies Hz, m/s^2.

The spectrum of what was measured, less that of the sensor at rest, is divided by the spectrum of the commanded motion.
What remains is the gain of the axis: 1 where it is rigid, and a peak at every mode. The shaper is chosen on that gain,
above the mode on the displacement that belongs to it; frequency and damping come from a mode fitted to the highest
peak.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import welch

from . import shapers
from .evidence import EvidenceError
from .execution import TICK
from .sweep import AXES, Sweep

SEGMENT = 2.0  # s of a piece of the Welch estimate: bins of 0.5 Hz
BAND = (5.0, 134.0)  # Hz that is looked at
MIN_SHARE = 0.9  # of the samples of the sweep that must be there
CLIPPED = 1e-4  # share of the samples of the sweep at the end of the range
STEEP = 6.0  # the highest gain over the median of them, squares: less is flat
CLEAR = 5.0  # measured power over that at rest, at the peak
WEAK = 1e-3  # of the strongest excitation: below it there is no gain
FITTED = (0.75, 1.3)  # times the frequency of the peak
MISFIT = 0.35  # rms of the logarithm of the squared gain


@dataclass(frozen=True)
class Samples:
    """What an accelerometer said: values (n, 3) m/s^2 along x, y and z of the machine, `rate` 1/s. `rest` (m, 3): the
    same before the motion. `range`: where it clips, m/s^2; `lost`: samples that did not arrive."""

    values: np.ndarray
    rest: np.ndarray
    rate: float
    range: float = math.inf
    lost: int = 0


@dataclass(frozen=True)
class Mode:
    """hz without damping; damping ratio; share of the motion that swings in it."""

    hz: float
    damping: float
    share: float


@dataclass(frozen=True)
class Resonance:
    """What the sweep of an axis shows. gain (n,) at hz (n,): square of the acceleration over that commanded, along the
    axis; total: the same with what the other axis does; raw (n, 3): PSD as measured, m^2/s^3."""

    axis: str
    hz: np.ndarray
    gain: np.ndarray
    total: np.ndarray
    raw: np.ndarray
    mode: Mode
    candidates: list[shapers.Candidate]

    @property
    def chosen(self) -> shapers.Candidate:
        """The shaper to take."""
        return shapers.choose(self.candidates)

    def settings(self) -> list[tuple[str, float]]:
        """What the controller is told, in this order: off first, the type last."""
        name, c = f'shape_{self.axis}', self.chosen
        return [
            (name, 0.0),
            (f'{name}_hz', c.hz),
            (f'{name}_damping', round(c.damping, 3)),
            (name, float(1 + shapers.TYPES.index(c.type))),
        ]


def psd(values: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (k,) and one-sided power spectral density (k, ...) of values (n, ...) by Welch's method. Pieces
    overlap by three quarters: so every sample has the same weight."""
    piece = round(SEGMENT * rate)
    return welch(values, rate, nperseg=piece, noverlap=3 * piece // 4, axis=0, detrend='constant')


def energy(values: np.ndarray, rate: float, mean: np.ndarray | float) -> np.ndarray:
    """Energy spectrum (k, ...) of values (n, ...) less their mean, at the frequencies of `psd`. A piece of nothing
    before and behind them lets their ends count in full, wherever the motion begins and ends in the record."""
    piece = round(SEGMENT * rate)
    whole = np.zeros((len(values) + 2 * piece, *values.shape[1:]))
    whole[piece:-piece] = values - mean
    return psd(whole, rate)[1] * len(whole) / rate


def analyse(samples: Samples, sweep: Sweep, axis: str) -> Resonance:
    """EvidenceError when the samples do not show a mode."""
    _check(samples, sweep)
    hz, measured = psd(samples.values, samples.rate)
    _, rest = psd(samples.rest, samples.rate)
    driven = energy(sweep.commanded(), 1.0 / TICK, 0.0)
    heard = energy(samples.values, samples.rate, samples.rest.mean(axis=0))
    heard -= rest * len(samples.values) / samples.rate
    n = min(len(hz), len(driven))
    inside = (hz[:n] >= BAND[0]) & (hz[:n] <= min(BAND[1], sweep.high))
    inside &= driven[:n] > WEAK * driven[:n].max()
    clean = np.maximum(heard[:n], 0.0)[inside]
    total = (clean[:, 0] + clean[:, 1]) / driven[:n][inside]
    gain = clean[:, AXES.index(axis)] / driven[:n][inside]
    noise = rest[:n][inside].mean(axis=0)[AXES.index(axis)]
    hz = hz[:n][inside]
    _check_peak(hz, gain, measured[:n][inside][:, AXES.index(axis)], noise)
    mode = fit(hz, gain)
    # above the mode by displacement, which is what a bead shows: power falls with the fourth power of the frequency
    weight = np.minimum(1.0, (mode.hz / hz) ** 4)
    found = shapers.propose(hz, total * weight, min(max(mode.damping, 0.01), 0.2))
    return Resonance(axis, hz, gain, total, measured[:n][inside], mode, found)


def _check(samples: Samples, sweep: Sweep) -> None:
    values = samples.values
    if values.ndim != 2 or values.shape[1:] != (3,) or samples.rest.shape[1:] != (3,):
        raise EvidenceError('the samples must have three columns: x, y, z')
    if not samples.rate > 2.5 * sweep.high:
        text = f'{samples.rate:g} samples/s are too few for {sweep.high:g} Hz'
        raise EvidenceError(f'{text}: at least {2.5 * sweep.high:g}')
    wanted = MIN_SHARE * sweep.duration * samples.rate
    if len(values) < wanted:
        text = f'too few samples: {len(values)} of {sweep.duration * samples.rate:.0f}'
        raise EvidenceError(f'{text}; was the sensor on during the whole sweep?')
    if len(samples.rest) < SEGMENT * samples.rate:
        raise EvidenceError(
            f'too few samples at rest: {len(samples.rest)}, {SEGMENT:g} s are needed'
        )
    if not (np.isfinite(values).all() and np.isfinite(samples.rest).all()):
        raise EvidenceError('a sample is not a finite number')
    if samples.lost > (1 - MIN_SHARE) * len(values):
        raise EvidenceError(
            f'{samples.lost} samples were lost on the way, {len(values)} came: look at the link'
        )
    clipped = np.mean(np.abs(values) >= 0.995 * samples.range)
    if clipped > CLIPPED:
        text = f'{100 * clipped:.2f} % of the samples are clipped at {samples.range:g} m/s^2'
        raise EvidenceError(f'{text}: a smaller acceleration, or a sensor of larger range')


def _check_peak(hz: np.ndarray, gain: np.ndarray, measured: np.ndarray, noise: float) -> None:
    if len(hz) < 20:
        raise EvidenceError('too few frequencies were shaken: a wider sweep is needed')
    top = int(np.argmax(gain))
    if not measured[top] > CLEAR * noise:
        raise EvidenceError(
            'the sensor saw no motion above its noise: is it fixed to the axis that moved, and switched on?'
        )
    steep = float(gain[top] / max(np.median(gain), 1e-12))
    if steep < STEEP:
        text = f'the spectrum is flat: its highest peak is {steep:.1f} times the median'
        raise EvidenceError(f'{text}, at least {STEEP:g} are asked for; no shaper is needed')
    if top in (0, len(hz) - 1):
        raise EvidenceError(
            f'the gain is highest at the edge of the band, {hz[top]:.1f} Hz: the mode lies outside'
        )


def _model(hz: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Squared gain of one mode and what else moves along. p: Hz, damping, share, rest."""
    r = hz / p[0]
    swing = 2j * p[1] * r
    return np.abs(p[2] * (1 + swing) / (1 - r * r + swing) + p[3]) ** 2


def fit(hz: np.ndarray, gain: np.ndarray) -> Mode:
    """The mode of the highest peak of gain (n,), squares, at hz (n,). EvidenceError when no mode fits it."""
    smooth = np.convolve(gain, np.ones(3) / 3, mode='same')
    peak = float(hz[int(np.argmax(smooth))])
    near = (hz >= FITTED[0] * peak) & (hz <= FITTED[1] * peak) & (gain > 0)
    if near.sum() < 8:
        raise EvidenceError(f'the peak at {peak:.1f} Hz has too few frequencies around it')
    x, y = hz[near], np.log(gain[near])
    weight = np.sqrt(gain[near] / gain[near].max()) + 0.1

    def off(p: np.ndarray) -> np.ndarray:
        return weight * (np.log(np.maximum(_model(x, p), 1e-12)) - y)

    height = math.sqrt(float(gain[near].max()))
    start = [peak, min(max(0.5 / height, 0.01), 0.3), 0.9, 0.1]
    bounds = ([0.8 * peak, 0.002, 0.05, -1.0], [1.2 * peak, 0.5, 3.0, 2.0])
    found = least_squares(off, start, bounds=bounds)
    misfit = math.sqrt(float(np.mean(found.fun**2) / np.mean(weight**2)))
    if misfit > MISFIT:
        raise EvidenceError(
            f'no mode fits the peak at {peak:.1f} Hz (misfit {misfit:.2f}, at most {MISFIT:g})'
        )
    frequency, damping, share = (float(v) for v in found.x[:3])
    return Mode(frequency, damping, share)
