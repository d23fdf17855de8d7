"""Waits for an interpass limit on a recorded wall: what the thermal compensator predicted against what was recorded.

Dwells of `../shared/data/interlayer_temperature` that fall by 60 K or more; at 25, 35 and 50 % of a dwell the monitor
is asked for the wait until the temperatures that were reached at 65, 80 and 95 % of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import find_peaks

from waam_adapt.thermal.interpass import InterpassMonitor, Settings
from waam_process import materials
from waam_process.heat import cooling_wait

from .paths import DATA

FOLDER = DATA / 'interlayer_temperature'
ASKED, LIMITS = (0.25, 0.35, 0.5), (0.65, 0.8, 0.95)


@dataclass(frozen=True)
class Forecast:
    """One question: error and that of one exponential, relative to the recorded wait; learned: by earlier dwells."""

    wall: str
    dwell: int
    asked: float
    error: float
    single: float
    learned: bool


def read(path: Path) -> np.ndarray:
    """(n, 2): s, degC; readings below the pyrometer's range are left out."""
    d = np.genfromtxt(path, delimiter=',', skip_header=1)
    return d[np.isfinite(d[:, 1])]


def dwells(t: np.ndarray, temperature: np.ndarray) -> list[slice]:
    """From each peak to the lowest reading before the next one or a gap, falls of at least 60 K.

    The free cooling after the last pass is none: no layer waits for it, and nothing like it came before.
    """
    even = np.convolve(np.pad(temperature, 1, 'edge'), np.full(3, 1 / 3), 'valid')
    peaks = [0, *find_peaks(even, prominence=8, distance=15)[0]]
    out = []
    for a, b in zip(peaks, peaks[1:], strict=False):
        end = a + int(np.argmin(temperature[a : b + 1]))
        gap = np.flatnonzero(np.diff(t[a : end + 1]) > 5)
        end = a + int(gap[0]) if len(gap) else end
        if end - a >= 12 and temperature[a] - temperature[end] >= 60:
            out.append(slice(a, end + 1))
    return out


def forecasts(path: Path) -> list[Forecast]:
    """All questions of one recorded wall."""
    t, temperature = read(path).T
    questions = {}
    for n, d in enumerate(dwells(t, temperature)):
        for share in ASKED:
            questions[d.start + int(share * (d.stop - d.start))] = (n, share, d)
    steel = materials.get('316l')
    monitor = InterpassMonitor(steel, Settings(200.0, timeout=6.0, window=6.0))
    out = []
    for i, (time, value) in enumerate(zip(t, temperature, strict=True)):
        monitor.add(time, value)
        if i in questions:
            out += _ask(monitor, path.stem, *questions[i], t, temperature, i)
    return out


def _ask(
    monitor, wall: str, n: int, share: float, d: slice, t, temperature, i: int
) -> list[Forecast]:
    out = []
    even = np.convolve(np.pad(temperature[d], 2, 'edge'), np.full(5, 0.2), 'valid')
    for place in LIMITS:
        at = t[d][0] + place * (t[d][-1] - t[d][0])
        limit, true = float(np.interp(at, t[d], even)), at - t[i]
        monitor.settings = replace(monitor.settings, interpass_limit=limit)
        heat = monitor.state(t[i])
        single = cooling_wait(heat.temperature, heat.rate, limit, monitor.material.t_env)
        if np.isfinite(heat.wait) and np.isfinite(single):
            learned = np.isfinite(monitor.cooling.wait(limit))
            out.append(
                Forecast(wall, n, share, heat.wait / true - 1, single / true - 1, bool(learned))
            )
    return out


def all_forecasts() -> list[Forecast]:
    return [f for path in sorted(FOLDER.glob('*.csv')) for f in forecasts(path)]
