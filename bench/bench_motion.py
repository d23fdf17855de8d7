"""Resonance and input shaping: the real controller core moves the simulated axes that swing, with their accelerometer.

motion.calibration_hz_error_pct: found against true frequency of the first mode of X, the worst of 20 gantries that are
drawn at random (seeds 101-120: 18 to 60 Hz, damping 0.02 to 0.1, second mode, coupling, load of the place). Baseline:
the highest peak of the raw spectrum, same samples.
motion.vibration_ratio, motion.vibration_ratio_off: residual vibration with the shaper that was calibrated over that
without a shaper, RMS over five moves, mean of five gantries (seeds 201-205): at the frequency that was found, and with
the shaper 15 % off it, the worse side. Baseline: without a shaper, um.
motion.corner_error_mm, motion.corner_error_fast_mm: distance of the commanded path from a right angle at 10 and 50 mm/s
with that shaper, the worst of the five. Baseline: without a shaper.
motion.bead_ripple_ratio: a bead along x and, round a right angle, along y at 10 mm/s on the simulated cell; RMS
distance from the second leg of the line that the wire is laid on, from 1 to 6 mm behind the corner, with the shaper
that was calibrated over that without, mean of five gantries (seeds 301-305). Baseline: without a shaper, um. The crown
of the bead shows none of it: a pool of 6 mm averages waves of 0.3 mm.
motion.idle_jerk_ratio: greatest jerk of an idle leg as plans have it over that of one move (trapezoid) with the same
highest speed and acceleration, at the steps, smoothed over 20 ms: the worst of legs of 14, 50 and 100 mm. Baseline:
trapezoid, m/s^3.
"""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
from lib.emit import emit
from lib.paths import SOURCES

FOUND, USED, LAID = range(101, 121), range(201, 206), range(301, 306)
SMOOTHED = 20  # ms
LEGS = (0.014, 0.05, 0.1)  # m, of idle moves


def shaken():
    """The harness of the package's tests; needs the built workspace."""
    sys.path.insert(0, str(SOURCES / 'waam_calibrate' / 'test'))
    import shaken

    return shaken


def gantry(seed: int):
    from waam_sim.gantry import GantryParams

    rng = np.random.default_rng(seed)
    hz = rng.uniform(18.0, 60.0)
    return GantryParams(
        on=True,
        x_hz=hz,
        x_damping=rng.uniform(0.02, 0.1),
        x_second_hz=hz * rng.uniform(2.0, 2.6),
        y_hz=rng.uniform(18.0, 60.0),
        y_damping=rng.uniform(0.02, 0.1),
        coupling=rng.uniform(0.0, 0.1),
        hz_per_m=rng.uniform(-0.5, 0.5),
    )


def calibrated(shaker):
    """What the sweep of X shows, and the samples."""
    from waam_calibrate.resonance import analyse
    from waam_calibrate.sweep import Sweep

    sweep = Sweep()
    samples = shaker.sweep(sweep, 'x')
    return analyse(samples, sweep, 'x'), samples


def frequency() -> None:
    from waam_calibrate.resonance import psd

    ours, raw = [], []
    for seed in FOUND:
        with shaken().Shaker(gantry(seed), seed) as shaker:
            found, samples = calibrated(shaker)
            true = shaker.plant.gantry.hz(0, shaken().POINT[0])
        hz, power = psd(samples.values[:, 0], samples.rate)
        inside = (hz >= 5) & (hz <= 134)
        peak = hz[inside][int(np.argmax(power[inside]))]
        ours.append(100 * abs(found.mode.hz / true - 1))
        raw.append(100 * abs(peak / true - 1))
    each = ', '.join(f'{v:.2f}' for v in ours)
    print(f'motion: frequency off by {each} %', file=sys.stderr)
    emit('motion.calibration_hz_error_pct', max(ours), '%', 'peak of the raw spectrum', max(raw))


def residual(shaker) -> float:
    """RMS (m) of the swing of X over 0.2 s after five moves have ended. They begin at rest, and go along X alone."""
    squares = []
    x, y, z = shaken().POINT
    shaker.go(((x, y, z), 0.05))
    shaker.machine.advance(1.0)
    for k, (way, speed) in enumerate(
        ((11e-3, 0.05), (7e-3, 0.03), (13e-3, 0.04), (3e-3, 0.02), (23e-3, 0.06))
    ):
        shaker.go(((x + way * (1 - k % 2), y, z), speed))
        shaker.off.clear()
        shaker.machine.advance(0.2)
        squares.append(np.array(shaker.off)[:, 0] ** 2)
    return float(np.sqrt(np.mean(squares)))


def corner(shaker, speed: float) -> float:
    """Distance (mm) of the commanded path from a right angle."""
    x, y, z = shaken().POINT
    shaker.go(((x - 0.02, y, z), 0.05))
    path: list[np.ndarray] = []
    listen = shaker.machine.on_exchange
    shaker.machine.on_exchange = lambda samples, plant: path.append(
        np.stack([-samples['table_x'], -samples['table_y']], axis=1)
    )
    shaker.go(((x, y, z), speed), ((x, y + 0.02, z), speed))
    shaker.machine.on_exchange = listen
    off = np.concatenate(path) - (x, y)
    return 1e3 * float(np.hypot(*off.T).min())


@cache
def shaped() -> dict[str, tuple[float, float]]:
    """Name -> value and baseline."""
    rows: list[dict[str, tuple[float, float]]] = []
    for seed in USED:
        with shaken().Shaker(gantry(seed), seed) as shaker:
            found, _ = calibrated(shaker)
            settings = found.settings()
            plain = residual(shaker)
            corners = [corner(shaker, v) for v in (0.01, 0.05)]
            shaker.configure(settings)
            at = residual(shaker)
            bent = [corner(shaker, v) for v in (0.01, 0.05)]
            off = 0.0
            for factor in (0.85, 1.15):
                hz = round(found.chosen.hz * factor, 2)
                shaker.configure([('shape_x_hz', hz)])
                off = max(off, residual(shaker))
        c = found.chosen
        print(
            f'motion: seed {seed}: {c.type} {c.hz:g} Hz for {found.mode.hz:.2f} Hz: {1e6 * plain:.2f}, '
            f'{1e6 * at:.2f}, 15 % off {1e6 * off:.2f} um',
            file=sys.stderr,
        )
        rows.append(
            {
                'vibration_ratio': (at / plain, 1e6 * plain),
                'vibration_ratio_off': (off / plain, 1e6 * plain),
                'corner_error_mm': (bent[0], corners[0]),
                'corner_error_fast_mm': (bent[1], corners[1]),
            }
        )
    found_all = {}
    for name in rows[0]:
        value, base = np.array([r[name] for r in rows]).T
        worst = name.startswith('corner')
        found_all[name] = (float(value.max() if worst else value.mean()), float(base.mean()))
    return found_all


def shaping() -> None:
    for name, (value, base) in shaped().items():
        corner_mm = name.startswith('corner')
        unit, said = ('mm', 'no shaper, mm') if corner_mm else ('', 'no shaper, um')
        emit(f'motion.{name}', value, unit, said, base)


def ripple_of(params, seed: int, settings: list[tuple[str, float]]) -> float:
    """RMS distance (m) of the wire from the second leg of a bead with a corner, from 1 to 6 mm behind it."""
    import steps_bead

    from waam_sim.plant import PlantParams

    corner, z = (0.045, 0.020), steps_bead.THICK
    path = [(0.015, corner[1], z), (*corner, z), (corner[0], 0.045, z)]
    with steps_bead.Layer(PlantParams(gantry=params), seed, 0.08) as layer:
        layer.configure(settings)
        at: list[tuple[float, float]] = []

        def note(samples: np.ndarray, plant) -> None:
            zero, swing = plant.params.work_zero, plant.gantry.deviation
            x, y = (-float(samples[name][-1]) for name in ('table_x', 'table_y'))
            if plant.arc_on:
                at.append((x + swing[0] - zero[0], y + swing[1] - zero[1]))

        layer.machine.on_exchange = note
        layer.bead(path, [0.01, 0.01])
    x, y = np.array(at).T
    behind = (y > corner[1] + 1e-3) & (y < corner[1] + 6e-3)
    return float(np.sqrt(np.mean((x[behind] - corner[0]) ** 2)))


def ripple() -> None:
    ratios, plain = [], []
    for seed in LAID:
        params = gantry(seed)
        with shaken().Shaker(params, seed) as shaker:
            settings = calibrated(shaker)[0].settings()
        before, after = (ripple_of(params, seed, told) for told in ([], settings))
        print(
            f'motion: seed {seed}: bead {1e6 * before:.2f}, shaped {1e6 * after:.2f} um',
            file=sys.stderr,
        )
        ratios.append(after / before)
        plain.append(1e6 * before)
    emit(
        'motion.bead_ripple_ratio',
        float(np.mean(ratios)),
        '',
        'no shaper, um',
        float(np.mean(plain)),
    )


def jerk(place: np.ndarray) -> float:
    """Greatest jerk (m/s^3) of places (n,) m, one per ms, in steps: each difference is smoothed."""
    window = np.ones(SMOOTHED) / SMOOTHED
    for _ in range(3):
        place = np.convolve(np.diff(place) / 1e-3, window, mode='valid')
    return float(abs(place).max())


def idle_jerk(shaker, length: float, law: str) -> float:
    """Greatest jerk (m/s^3) of an idle leg along x as the planner makes it."""
    from waam_plan.plan import leg
    from waam_plan.settings import PlanSettings

    settings = PlanSettings(idle_law=law)
    x, y, z = shaken().POINT
    start, end = (x - length / 2, y, z), (x + length / 2, y, z)
    shaker.go((start, settings.idle_speed))
    path: list[np.ndarray] = []
    shaker.machine.on_exchange = lambda samples, plant: path.append(-samples['table_x'])
    shaker.go(*((s.end, s.speed) for s in leg(start, end, settings)))
    return jerk(np.concatenate(path))


def idle() -> None:
    from waam_sim.gantry import GantryParams

    found = {}
    with shaken().Shaker(GantryParams()) as shaker:
        for length in LEGS:
            plain = idle_jerk(shaker, length, 'plain')
            found[length] = idle_jerk(shaker, length, 'harmonic') / plain, plain
    each = ', '.join(f'{1e3 * k:g} mm {v:.3f}' for k, (v, _) in found.items())
    print(f'motion: idle legs: {each}', file=sys.stderr)
    ratio, plain = max(found.values())
    emit('motion.idle_jerk_ratio', ratio, '', 'trapezoid, m/s^3', plain)


FIGURES = {
    'motion.calibration_hz_error_pct': frequency,
    'motion.vibration_ratio': shaping,
    'motion.vibration_ratio_off': shaping,
    'motion.corner_error_mm': shaping,
    'motion.corner_error_fast_mm': shaping,
    'motion.bead_ripple_ratio': ripple,
    'motion.idle_jerk_ratio': idle,
}
