"""The standoff control (the C code of the core, through the library waam_standoff_loop), in a host simulation of
sensor, arc and metal; laboratory and graph do not have these sensors yet.

standoff.laser_rms_mm, standoff.arc_rms_mm: error of the contact distance over a bead of 60 s on a part that rises by
3 mm while it is welded, seeds 101-110 (rise in 10 to 40 s, 0.2 mm of roughness; laser: 0.01 mm, 2 ms, 1 % of the
readings lost; arc: noise of arc length, current, voltage and wire, current up to 5 % off the model). Baseline: no
tracking. The first 1.5 s are left out: the arc strikes, settles, and its current is compared with the distance.
standoff.step_s: 3 mm to 0.1 mm by the relay, step division 1/16, ideal drive (baseline: source 001, recomputed).
standoff.too_close, standoff.closest_mm: 10 000 runs with a random fault of the sensor (standoff_faults.c, seeds 101 to
110): runs with the torch closer than half its contact distance; smallest distance of all.
standoff.picture (a table): draws waam_firmware/doc/standoff.png, the step of source 001 with and without filters.
"""

from __future__ import annotations

import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from lib.emit import emit
from lib.paths import SOURCES

SEEDS = range(101, 111)
SECONDS, SKIPPED = 60.0, 1.5
RISE = 3.0  # mm
FIRMWARE = SOURCES / 'waam_firmware'


def control():
    """The code of the control with its harness; needs the built workspace."""
    sys.path.insert(0, str(FIRMWARE / 'test'))
    import standoff_loop

    return standoff_loop


def metal(rng: np.random.Generator) -> np.ndarray:
    """Height of the metal under the arc, mm, one value per ms."""
    t = np.arange(round(SECONDS * 1000)) * 1e-3
    rough = sum(
        0.12 * np.sin(2 * math.pi * (t / period + rng.uniform())) for period in (1.3, 2.9, 5.1)
    )
    rise = RISE * (1 - np.exp(-t / (rng.uniform(10.0, 40.0) / 3)))
    return rise + rough - rough[0]


def bead(seed: int, source: int) -> np.ndarray:
    """Error of the contact distance, mm, one value per ms."""
    loop = control()
    rng = np.random.default_rng(seed)
    surface = metal(rng)
    if source == loop.OFF:
        return -surface
    arc = source == loop.ARC
    loop.start(source=source, **({'set_mm': loop.CONTACT, 'kp': 2.0, 'ki': 0.5} if arc else {}))
    lib, answer = loop.library(), loop.Answer()
    lib.standoff_loop_path(loop.FOLLOW, 0.0, 0.0, 22.0)
    model, length, reading, value = 138.0 * rng.uniform(0.95, 1.05), 0.0, 0, 100.0
    current_read, voltage_read, wire = model, 22.0, 110.0
    errors = np.empty(len(surface))
    noise = rng.standard_normal((len(surface), 4))
    for ms, height in enumerate(surface):
        error = answer.correction - height
        errors[ms] = error
        length += -0.02 * length + 0.2 * 0.45 * noise[ms, 0]
        if ms % 10 == 0:
            wire = 110.0 + 0.5 * round(noise[ms, 3])
            speed = (wire / 110.0) ** 0.65
            current_read = model * speed * (1 - 0.024 * error) - 7.0 * length + 1.5 * noise[ms, 1]
            voltage_read = 22.0 + length + 0.15 * noise[ms, 2]
        if ms % 2 == 0:
            reading += 1
            value = (
                round(100.0 + error + 0.01 * noise[ms, 1], 2) if noise[ms, 2] < 2.33 else math.nan
            )
        lib.standoff_loop_step(reading, value, current_read, voltage_read, wire, answer)
    if answer.alarms:
        print(f'standoff: seed {seed}, source {source}: alarm {answer.alarm}', file=sys.stderr)
    return errors


def rms(source: int) -> float:
    late = round(SKIPPED * 1000)
    return float(np.sqrt(np.mean([bead(seed, source)[late:] ** 2 for seed in SEEDS])))


def warping_part() -> None:
    loop = control()
    without = rms(loop.OFF)
    for name, source in (('laser', loop.LASER), ('arc', loop.ARC)):
        emit(f'standoff.{name}_rms_mm', rms(source), 'mm', 'no tracking, same seeds', without)


def of_source(loop, **changed: float) -> dict[str, float]:
    return {**loop.RELAY_OF_SOURCE, **changed}


def step() -> None:
    loop = control()
    settings = of_source(loop, rc_s=0, average=1, pulse_mm=loop.of_division(16))
    taken = loop.arrival(loop.run(loop.Ideal(), np.full(5000, -3.0), **settings))
    emit('standoff.step_s', taken, 's', 'source 001, recomputed', 2.27)


def faults_of(seed: int) -> list[list[str]]:
    from ament_index_python.packages import get_package_prefix

    program = f'{get_package_prefix("waam_firmware")}/lib/waam_firmware/standoff_faults'
    done = subprocess.run([program, '1000', str(seed)], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(f'{program}: exit status {done.returncode} {done.stderr}')
    return [line.split() for line in done.stdout.splitlines()]


def bad_sensors() -> None:
    with ThreadPoolExecutor(2) as pool:
        rows = [row for found in pool.map(faults_of, SEEDS) for row in found]
    for kind in dict.fromkeys(row[0] for row in rows):
        runs, _, close, alarms, home = (
            sum(float(row[i]) for row in rows if row[0] == kind) for i in range(1, 6)
        )
        least = min(float(row[2]) for row in rows if row[0] == kind)
        text = f'{kind}: {runs:.0f} runs, closest {least:.2f} mm, {alarms:.0f} alarms, {home:.0f} of them back'
        print(f'standoff: {text}', file=sys.stderr)
    emit('standoff.too_close', sum(float(r[3]) for r in rows), 'runs', 'wanted', 0.0)
    emit(
        'standoff.closest_mm',
        min(float(r[2]) for r in rows),
        'mm',
        'half the contact distance',
        7.5,
    )


def picture() -> None:
    """The step of 3 mm with the infrared sensor of source 001: filters, step division, and what the axis knows."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    loop = control()
    t = np.arange(6000) * 1e-3
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), sharey=True, layout='constrained')
    for division in (8, 16, 32, 128):
        settings = of_source(loop, source=loop.INFRARED, pulse_mm=loop.of_division(division))
        run = loop.run(loop.Infrared(101), np.full(6000, -3.0), **settings)
        axes[0].plot(t, run, lw=1, label=f'step division 1/{division}')
    plain = {'rc_s': 0, 'average': 1}
    for name, known, changed in (
        ('without filters', False, plain),
        ('with filters (source)', False, {}),
        ('with filters, own motion known', True, {}),
    ):
        settings = of_source(loop, source=loop.INFRARED, pulse_mm=loop.of_division(16), **changed)
        run = loop.run(loop.Infrared(101), np.full(6000, -3.0), known, **settings)
        axes[1].plot(t, run, lw=1, label=name)
    axes[0].set(title='relay with filters', ylabel='true distance, mm')
    axes[1].set(title='relay, step division 1/16', ylim=(99.4, 103.1))
    for axis in axes:
        axis.axhspan(99.9, 100.1, color='0.9')
        axis.set_xlabel('time after the step, s')
        axis.legend(fontsize=8)
    figure.savefig(FIRMWARE / 'doc' / 'standoff.png', dpi=90)
    print(f'standoff.picture: {FIRMWARE / "doc" / "standoff.png"}')


FIGURES = {
    'standoff.laser_rms_mm': warping_part,
    'standoff.arc_rms_mm': warping_part,
    'standoff.step_s': step,
    'standoff.too_close': bad_sensors,
    'standoff.closest_mm': bad_sensors,
}
TABLES = {'standoff.picture': picture}
