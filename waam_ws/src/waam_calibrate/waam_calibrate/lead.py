"""Lead of the wire: from a recorded bead with steps of speed to the delay and the lag of the wire drive. Pure. SI.

The drive is taken as a delay and a first-order lag behind the commanded wire speed, the encoder as a factor on it:
measured(t) = ratio * x(t), lag * dx/dt = commanded(t - delay) - x. The controller makes up for both when it knows
them: it asks for the speed of a moment later, and leads the lag down to its `response` (waam_wire.h).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from .evidence import EvidenceError

GRID = 1e-3  # s, of the model
SLOWEST = 0.021  # s between two frames: 100 Hz, one in two may be missing
MIN_STEPS = 4
STEP = 0.10  # change of the commanded wire speed that counts as a step, of its mean
PLATEAU = 0.3  # s before and behind a step that its speed is taken from
STRIKE = 1.0  # s after the arc has struck that do not count
MISFIT = 0.25  # rms of what the model leaves over that of the steps
SURE = 5e-3  # s, standard uncertainty of delay and lag
RATIO = (0.8, 1.25)  # encoder over command
MAX_LEAD = (0.25, 0.5)  # s, delay and lag that the controller takes
QUICKEST = 0.02  # s, shortest response that the feeder's acceleration allows
SHARE = 0.3  # of the lag that is left as response


@dataclass(frozen=True)
class WireRecord:
    """Frames (n,) of a record: time in s, rising; commanded and measured wire speed in m/s; whether the arc burns."""

    time: np.ndarray
    commanded: np.ndarray
    measured: np.ndarray
    burns: np.ndarray


@dataclass(frozen=True)
class Lead:
    """delay, lag: of the drive, s, with their standard uncertainties; ratio: encoder over command; steps: used;
    misfit: share of the steps that the model leaves. time, measured, modelled (n,): what was compared."""

    delay: float
    lag: float
    delay_sigma: float
    lag_sigma: float
    ratio: float
    steps: int
    misfit: float
    time: np.ndarray
    measured: np.ndarray
    modelled: np.ndarray

    @property
    def response(self) -> float:
        """s, that the controller leads the lag down to; with no more lag than that it does not lead."""
        return float(np.clip(SHARE * self.lag, QUICKEST, MAX_LEAD[0]))

    def settings(self) -> list[tuple[str, float]]:
        """What the controller is told. The response first: a long lead must not meet a short one of before."""
        found = {
            'wire_response_s': self.response,
            'wire_delay_s': min(max(self.delay, 0.0), MAX_LEAD[0]),
            'wire_lag_s': min(self.lag, MAX_LEAD[1]),
        }
        return [(name, round(value, 4)) for name, value in found.items()]


def identify(record: WireRecord, reading: float = 0.0) -> Lead:
    """reading: s by which the encoder's value is older than its frame. EvidenceError when the record does not show the
    drive."""
    used = _check(record)
    at = record.time - record.time[0]
    commanded, measured = record.commanded, record.measured
    grid = np.arange(0.0, at[-1] + GRID, GRID)
    count = steps_of(at, commanded, used)
    if count < MIN_STEPS:
        text = f'{count} steps of the wire speed of {100 * STEP:g} % and more while the arc burns'
        raise EvidenceError(f'{text}, {MIN_STEPS} at least: lay the bead of --program')

    def modelled(p: np.ndarray) -> np.ndarray:
        return p[2] * follow(at, commanded, grid, p[0] + reading, p[1])

    def off(p: np.ndarray) -> np.ndarray:
        return (modelled(p) - measured)[used] / scale

    scale = float(np.std(measured[used]))
    if not scale > 0:
        raise EvidenceError('the encoder always reads the same: is it connected?')
    bounds = ([-reading, 1e-3, 0.3], [2 * MAX_LEAD[0], 2 * MAX_LEAD[1], 3.0])
    tries = [
        least_squares(off, [delay, lag, 1.0], bounds=bounds, x_scale=[0.01, 0.01, 0.1])
        for delay, lag in ((0.02, 0.05), (0.08, 0.15))
    ]
    best = min(tries, key=lambda t: t.cost)
    misfit = float(np.sqrt(np.mean(best.fun**2)))
    delay, lag, ratio = (float(v) for v in best.x)
    sigma = _sigma(best.jac, best.fun)
    _judge(ratio, misfit, sigma)
    return Lead(
        delay=delay, lag=lag, delay_sigma=sigma[0], lag_sigma=sigma[1], ratio=ratio, steps=count, misfit=misfit,
        time=record.time[used], measured=measured[used], modelled=modelled(best.x)[used],
    )  # fmt: skip


def follow(
    time: np.ndarray, commanded: np.ndarray, grid: np.ndarray, delay: float, lag: float
) -> np.ndarray:
    """Speed of the drive (n,) at `time` (n,); grid: times of the model, every GRID seconds."""
    late = np.interp(grid - delay, time, commanded)
    keep = np.exp(-GRID / lag)
    out, _ = lfilter([1 - keep], [1, -keep], late, zi=[keep * late[0]])
    return np.interp(time, grid, out)


def steps_of(time: np.ndarray, commanded: np.ndarray, used: np.ndarray) -> int:
    """Steps of the commanded speed among the frames that are used (n,) bool."""
    before = np.interp(time - PLATEAU, time, commanded)
    after = np.interp(time + PLATEAU, time, commanded)
    change = (np.abs(after - before) > STEP * commanded[used].mean()) & used
    begun = time[np.flatnonzero(np.diff(change.astype(int)) == 1)]
    return int(np.count_nonzero(np.diff(begun, prepend=-np.inf) > PLATEAU))


def _check(record: WireRecord) -> np.ndarray:
    """Frames (n,) bool that count. EvidenceError."""
    n = len(record.time)
    columns = (record.commanded, record.measured, record.burns)
    if n < 100 or any(len(c) != n for c in columns):
        raise EvidenceError(f'{n} frames of telemetry: that is no bead')
    if not all(np.isfinite(c).all() for c in (record.time, *columns)):
        raise EvidenceError('a value of the telemetry is not a finite number')
    between = np.diff(record.time)
    if not (between > 0).all():
        raise EvidenceError('the times of the telemetry do not rise')
    if np.median(between) > SLOWEST:
        rate = 1 / float(np.median(between))
        raise EvidenceError(f'{rate:.0f} frames per second do not show the lag: 50 at least')
    lit = record.burns.astype(bool) & (record.commanded > 0)
    if not lit.any():
        raise EvidenceError('the arc never burns in this record')
    begun = np.flatnonzero(np.diff(lit.astype(int), prepend=0) == 1)
    used = lit.copy()
    for first in begun:
        used &= ~((record.time >= record.time[first]) & (record.time < record.time[first] + STRIKE))
    if used.sum() < 100:
        raise EvidenceError(f'the arc burns for {used.sum()} frames only: a longer bead is needed')
    missing = float(between[used[1:] & used[:-1]].max())
    if missing > 0.1:
        raise EvidenceError(f'telemetry is missing for {missing:.2f} s while the arc burns')
    return used


def _sigma(jac: np.ndarray, rest: np.ndarray) -> tuple[float, float]:
    """Of delay and lag. What is left is not white: its correlation makes the samples fewer."""
    lag1 = float(rest[1:] @ rest[:-1] / max(rest @ rest, 1e-30))
    fewer = (1 + max(lag1, 0.0)) / max(1 - lag1, 0.05)
    normal = jac.T @ jac
    if np.linalg.cond(normal) > 1e12:
        return np.inf, np.inf
    cov = np.linalg.inv(normal) * float(rest @ rest) / max(1, len(rest) - 3) * fewer
    return float(np.sqrt(cov[0, 0])), float(np.sqrt(cov[1, 1]))


def _judge(ratio: float, misfit: float, sigma: tuple[float, float]) -> None:
    if not RATIO[0] <= ratio <= RATIO[1]:
        raise EvidenceError(
            f'the encoder reads {ratio:.2f} of the command: calibrate the wire wheel first'
        )
    if misfit > MISFIT:
        text = f'a delay and a lag leave {100 * misfit:.0f} % of the steps unexplained'
        raise EvidenceError(f'{text}, at most {100 * MISFIT:g} %: does the wire slip?')
    if max(sigma) > SURE:
        text = f'delay and lag are uncertain by {1e3 * sigma[0]:.1f} and {1e3 * sigma[1]:.1f} ms'
        raise EvidenceError(f'{text}, at most {1e3 * SURE:g} ms: more steps of speed')


def program(feed: float, speed: float, length: float, steps: int) -> str:
    """G-code (dialect waam) of a bead with steps of travel and wire speed, the wire per mm the same. feed: m/s of wire
    at the speed `speed` (m/s); every second piece of `length` (m) is half as fast again."""
    rows = [
        '; bead with steps of speed for: waam calibrate lead', 'G21 G90', 'G0 Z10', 'G0 X0 Y0',
        f'G1 Z0 F600 W{60e3 * feed:.0f} S22', 'M3',
    ]  # fmt: skip
    for k in range(steps + 1):
        factor = 1.5 if k % 2 else 1.0
        x = 1e3 * length * (k + 1)
        rows.append(f'G1 X{x:.3f} F{60e3 * speed * factor:.1f} W{60e3 * feed * factor:.0f}')
    return '\n'.join([*rows, 'M5', 'G0 Z10', ''])
