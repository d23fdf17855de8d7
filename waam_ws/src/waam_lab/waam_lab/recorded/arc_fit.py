"""An arc log: the simulated arc fed with the recorded wire, until its scatter, drift and correlation are those of the
log. Every figure has one parameter that moves it most, so each step is a proportion (method of moments)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from waam_sim.arc import REFERENCE_CTWD, Arc, ArcParams, advance_arc
from waam_sim.compiled import SOURCES, jit, random_state

from ..twin.records import RecordError
from .arc_figures import Steady, errors, figures, steady
from .finding import NINETY, Figure, Finding, Parameter
from .read import Recording

DT = 1e-3  # s, step of the simulated arc
SETTLE = 400  # steps before the first row
STEPS, SEEDS = 7, (11, 12, 13)  # of the fit
CHECK = (21, 22, 23, 24)  # seeds of the misfit that is told; not those of the fit
FEWEST = 10.0  # s of steady arc
TELLS = (
    0.42  # relative standard error up to which a parameter counts as told: within a factor of two
)
DRIFTS = 8.0  # times the drift's own time that a log must be long
SHOWN = (
    ('mean current', 'A', 'current'), ('current, sigma within a second', 'A', 'fast_current'),
    ('current, sigma of means over 1 s', 'A', 'slow_current'), ('voltage, sigma within a second', 'V', 'fast_voltage'),
    ('voltage, sigma of means over 1 s', 'V', 'slow_voltage'), ('fall of the current per volt', 'A/V', 'slope'),
    ('correlation of current and voltage', '', 'correlation'),
    ('correlation of their means over 1 s', '', 'slow_correlation'), ('time of the drift', 's', 'drift_time'),
)  # fmt: skip
SILENT = (
    'contact distance: 15 mm are assumed; arc_current_ref holds for the distance that was there, and '
    'arc_current_per_m is not told',
    'how current and voltage were averaged in the source: quick scatter is that of the readings',
    'arc_current_exponent, unless the wire feed was varied on purpose',
    'whether drift is of tip, wire or source: it is taken as arc_drift_*',
)


def _make() -> Callable:
    SOURCES  # noqa: B018  part of the key of numba's cache

    @jit
    def readings(p, s, rng, t, wire, run, volts, settle, dt, out):  # type: ignore[no-untyped-def]
        """Readings (n, 2) of current and voltage at the rows; every run begins with a settled arc."""
        before = -1
        for i in range(t.size):
            if run[i] != before:
                s.lit, s.current, s.starving = 1.0, 100.0, 0.0
                steps = settle
            else:
                steps = max(int((t[i] - t[i - 1]) / dt + 0.5), 1)
            before = run[i]
            s.wire = wire[i]
            volts_now = volts[i]
            for _ in range(steps):
                s.lit = 1.0
                advance_arc(
                    p=p, s=s, rng=rng, on=True, gas=True, blocked=False, voltage_set=volts_now,
                    ctwd=REFERENCE_CTWD, dt=dt,
                )  # fmt: skip
            out[i, 0], out[i, 1] = s.current_read, s.voltage_read

    return readings


_readings = _make()


def simulated(p: ArcParams, seen: Steady, seed: int) -> Steady:
    """What the simulated arc reads with the recorded wire, 15 mm of contact distance and a set voltage that gives the
    recorded mean and follows the wire as that of the source did."""
    arc = Arc.cold(p, random_state(seed))
    arc.state['flow'] = 1.0
    off = seen.wire - seen.wire.mean()
    line = float(off @ seen.voltage) / max(float(off @ off), 1e-9)
    volts = seen.voltage.mean() + p.resistance * seen.current.mean() + max(line, 0.0) * off
    out = np.zeros((seen.t.size, 2))
    _readings(
        p=arc.params[0],
        s=arc.state[0],
        rng=arc.rng,
        t=seen.t,
        wire=seen.wire * p.wire_ratio,
        run=seen.run,
        volts=volts,
        settle=SETTLE,
        dt=DT,
        out=out,
    )
    return replace(seen, current=out[:, 0], voltage=out[:, 1])


def _mean(p: ArcParams, seen: Steady, seeds: tuple[int, ...]) -> dict[str, float]:
    found = [figures(simulated(p, seen, seed)) for seed in seeds]
    return {name: float(np.mean([f[name] for f in found])) for name in found[0]}


def misfit(told: dict[str, float], cell: dict[str, float]) -> float:
    """RMS over the figures of SHOWN: logarithm of the ratio, of correlations the difference."""
    off = []
    for _, _, name in SHOWN:
        a, b = told[name], cell[name]
        if 'correlation' in name:
            off.append(b - a)
        elif a > 0 and b > 0:
            off.append(math.log(b / a))
    return float(np.sqrt(np.mean(np.square(off))))


def fit_arc(recording: Recording, base: ArcParams) -> tuple[Finding, ArcParams]:
    """RecordError when there is too little of a steady arc."""
    seen = steady(recording.t, recording.telemetry)
    if seen.seconds < FEWEST:
        raise RecordError(
            f'{recording.name}: {seen.seconds:.1f} s of steady arc with current and voltage; '
            f'{FEWEST:.0f} s are needed'
        )
    told, error = figures(seen), errors(seen)
    able = _able(told, error, seen)
    p = _solve(base, told, seen, set(FIELDS))
    if sum(able.values()) not in (
        0,
        len(able),
    ):  # what is not told stays as it was: the rest is sought anew
        p = _solve(base, told, seen, {k for k, v in able.items() if v})
    before, after = _mean(base, seen, CHECK), _mean(_kept(base, p, able), seen, CHECK)
    if misfit(told, after) >= misfit(told, before):
        able, after = dict.fromkeys(able, False), before
    kept = _kept(base, p, able)
    error['slow_correlation'] = _doubt_of_correlation(told, seen)
    parameters = _parameters(base, p, told, error, able)
    shown = tuple(Figure(w, u, told[n], before[n], after[n]) for w, u, n in SHOWN)
    arcs = len(np.unique(seen.run))
    notes = [f'{seen.t.size} readings, {seen.seconds:.0f} s of steady arc in {arcs} arcs']
    if seen.held > 0.1:
        notes.append(f'{seen.held:.0%} of the rows repeat the reading before and do not count')
    if seen.longest <= max(DRIFTS * told['drift_time'], FEWEST):
        notes.append(f'the longest arc of {seen.longest:.1f} s is too short for its drift')
    if not seen.fed:
        notes.append('it has no wire feed: taken as constant, arc_current_ref is not told')
    if not any(able.values()):
        notes.append('no parameter is decided by it, the cell stays as it was')
    finding = Finding(
        recording.name,
        'arc log',
        (misfit(told, before), misfit(told, after)),
        'RMS of ln(simulated / recorded)',
        parameters,
        shown,
        SILENT,
        tuple(notes),
    )
    return finding, kept


FIELDS = {  # parameter -> the figure that it moves most, and how far that figure misleads (relative)
    'current_ref': ('current', 0.07),  # 3 mm of unknown contact distance
    'length_noise': ('fast_voltage', 0.12),
    'current_noise': ('slope', 0.13),
    'sensor_noise': ('rest', 0.12),
    'drift_current': ('slow_current', 0.1),
    'drift_voltage': ('slow_voltage', 0.1),
    'drift_time': ('drift_time', 0.2),
    'drift_correlation': ('slow_correlation', 0.1),
}


def _long_enough(told: dict[str, float], seen: Steady) -> bool:
    return seen.longest > max(DRIFTS * told['drift_time'], FEWEST)


def _able(told: dict[str, float], error: dict[str, float], seen: Steady) -> dict[str, bool]:
    """Which parameters the log decides."""
    able = {k: math.hypot(error[figure], doubt) <= TELLS for k, (figure, doubt) in FIELDS.items()}
    able['current_noise'] &= told['slope'] > 0
    able['current_ref'] &= seen.fed
    able['drift_correlation'] = _doubt_of_correlation(told, seen) <= 0.25
    drifts = _long_enough(told, seen)
    return {k: v and (drifts or not k.startswith('drift')) for k, v in able.items()}


def _doubt_of_correlation(told: dict[str, float], seen: Steady) -> float:
    """Standard error of the correlation of means: so many of them are independent."""
    independent = max(seen.seconds / max(told['drift_time'], 1.0), 4.0)
    return (1.0 - told['slow_correlation'] ** 2) / math.sqrt(independent - 3.0)


def _kept(base: ArcParams, p: ArcParams, able: dict[str, bool]) -> ArcParams:
    values: dict[str, float] = {k: getattr(p, k) for k, v in able.items() if v}
    return replace(base, **values)


def _solve(base: ArcParams, told: dict[str, float], seen: Steady, free: set[str]) -> ArcParams:
    start = {
        'drift_current': max(told['slow_current'], 0.1),
        'drift_voltage': max(told['slow_voltage'], 0.01),
        'drift_correlation': float(np.clip(told['slow_correlation'], -0.95, 0.95)),
        'drift_time': float(np.clip(told['drift_time'], 0.5, 60.0)),
    }
    p = replace(base, **{k: v for k, v in start.items() if k in free})
    for _ in range(STEPS):
        moved = _step(p, told, _mean(p, seen, SEEDS))
        p = replace(p, **{k: v for k, v in moved.items() if k in free})
    return p


def _step(p: ArcParams, told: dict[str, float], cell: dict[str, float]) -> dict[str, float]:
    """The next values, by proportion."""

    def by(name: str, power: float = 1.0) -> float:
        if told[name] <= 0 or cell[name] <= 0:
            return 1.0
        return float(np.clip(told[name] / cell[name], 0.5, 2.0) ** power)

    turn = told['slow_correlation'] - cell['slow_correlation']
    return {
        'current_ref': float(np.clip(p.current_ref * by('current'), 20.0, 500.0)),
        'length_noise': float(np.clip(p.length_noise * by('fast_voltage'), 1e-3, 5.0)),
        'current_noise': float(np.clip(p.current_noise * by('slope'), 0.01, 100.0)),
        'sensor_noise': float(np.clip(p.sensor_noise * by('rest'), 1e-3, 20.0)),
        'drift_current': float(np.clip(p.drift_current * by('slow_current'), 0.0, 50.0)),
        'drift_voltage': float(np.clip(p.drift_voltage * by('slow_voltage'), 0.0, 5.0)),
        'drift_correlation': float(np.clip(p.drift_correlation + 0.5 * turn, -0.98, 0.98)),
        'drift_time': float(np.clip(p.drift_time * by('drift_time', 0.5), 0.2, 100.0)),
    }


def _parameters(
    base: ArcParams,
    p: ArcParams,
    told: dict[str, float],
    error: dict[str, float],
    able: dict[str, bool],
) -> tuple[Parameter, ...]:
    found = []
    for field, (figure, doubt) in FIELDS.items():
        wide, value, usual = (
            math.hypot(error[figure], doubt),
            getattr(p, field),
            getattr(base, field),
        )
        name = f'arc_{field}'
        if field == 'drift_correlation':
            half = NINETY * error[figure]
            low, high = max(value - half, -1.0), min(value + half, 1.0)
            found.append(Parameter(name, value, low, high, usual, able[field]))
        else:
            found.append(Parameter.relative(name, value, wide, usual, able[field]))
    return tuple(found)
