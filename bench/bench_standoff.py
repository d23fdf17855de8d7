"""The standoff control: in whole jobs on the simulated cell, and alone in a host simulation.

In the laboratory, controller, bridge and job as they are, sensors and metal those of the simulated cell:
standoff.rms_mm, standoff.rms_arc_mm: true contact distance less 15 mm, by the laser and by the arc, from 1 s after each
strike on: two layers of a block of 60 x 40 mm on a plate that rises by 3 mm under the torch, seeds 1-20. Baseline: no
tracking, same seeds.
standoff.arc_lost: arcs that went out in 50 jobs (one layer of the block, seeds 1-50) with a map that is wrong by up to
10 mm in height and 0.02 in slope and has a step of 3 mm. The arc goes out nearer than 4 mm and farther than 30 mm.
By the laser, 12 mm up and 6 mm down. Baseline: no tracking, same jobs.

standoff.cell_too_close, standoff.cell_closest_mm: 60 jobs of one layer on the part that warps, by the laser with one of
six faults, the map wrong by up to 2 mm, seeds 1-10: jobs with the wire nearer than half its contact distance, and the
smallest distance of all. The fault lasts from the first strike on.

On the host, the control alone (the C code of the core, through the library waam_standoff_loop):

standoff.laser_rms_mm, standoff.arc_rms_mm: error of the contact distance over a bead of 60 s on a part that rises by
3 mm while it is welded, seeds 101-110 (rise in 10 to 40 s, 0.2 mm of roughness; laser: 0.01 mm, 2 ms, 1 % of the
readings lost; arc: noise of arc length, current, voltage and wire, current up to 5 % off the model). Baseline: no
tracking. The first 1.5 s are left out: the arc strikes, settles, and its current is compared with the distance.
standoff.arc_wander_rms_mm: the same by the arc where contact tip and wire wander by 1.6 mm of distance together
(1.2 mm in 4 s, 1.08 mm in 6 s), which the control is told. Baseline: no tracking. standoff.arc_wander_bound_mm: least
error by the arc of anyone who does not know by how much the part rises, but its course in time exactly; the wander is
the only noise. Baseline: wanted by the arc, 0.5 mm.
standoff.step_s: 3 mm to 0.1 mm by the relay, step division 1/16, ideal drive (baseline: source 001, recomputed).
standoff.too_close, standoff.closest_mm: 10 000 runs with a random fault of the sensor (standoff_faults.c, seeds 101 to
110): runs with the torch closer than half its contact distance; smallest distance of all.
standoff.picture (a table): draws waam_firmware/doc/standoff.png, the step of source 001 with and without filters.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from bench_shape import workers
from lib.emit import emit
from lib.paths import SOURCES
from lib.preset import emit_on_cell, preset
from scipy.signal import lfilter

SEEDS = range(101, 111)
LAB_SEEDS = range(1, 21)
WRONG_MAPS = range(1, 51)
FAULT_SEEDS = range(1, 11)
WARPS = {'part_warp': 3.5e-3, 'part_warp_energy': 4e4}
WANDERS = ((1.2, 4.0), (1.08, 6.0))  # mm, correlation time in s: contact tip, wire
BIAS = 2.0  # mm: of the arc's current, before anyone has compared it
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


def wandering(rng: np.random.Generator, count: int) -> np.ndarray:
    """What contact tip and wire add to the contact distance by the arc, mm, one value per ms."""
    out = np.zeros(count)
    for sigma, lasts in WANDERS:
        keep = math.exp(-1e-3 / lasts)
        noise = sigma * rng.standard_normal(count)
        noise[1:] *= math.sqrt(1 - keep * keep)
        out += lfilter([1.0], [1.0, -keep], noise)
    return out


def bead(seed: int, source: int, wanders: bool = False) -> np.ndarray:
    """Error of the contact distance, mm, one value per ms."""
    loop = control()
    rng = np.random.default_rng(seed)
    surface = metal(rng)
    if source == loop.OFF:
        return -surface
    arc = source == loop.ARC
    tip = wandering(rng, len(surface)) if wanders else np.zeros(len(surface))
    told = {'arc_wander_mm': math.hypot(*(sigma for sigma, _ in WANDERS))} if wanders else {}
    by_arc = {'set_mm': loop.CONTACT, 'kp': 2.0, 'ki': 0.5, 'answer_mm': 3.0, **told}
    loop.start(source=source, **(by_arc if arc else {}))
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
            current_read = (
                model * speed * (1 - 0.024 * (error + tip[ms])) - 7.0 * length + 1.5 * noise[ms, 1]
            )
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


def rms(source: int, wanders: bool = False) -> float:
    late = round(SKIPPED * 1000)
    return float(np.sqrt(np.mean([bead(seed, source, wanders)[late:] ** 2 for seed in SEEDS])))


def least_error() -> float:
    """mm RMS over a bead: height = amplitude (sigma RISE) times a course that is known, current off by BIAS, the wander
    of `WANDERS` on every value; the best linear estimator of what was measured so far."""
    t = np.arange(0.25, SECONDS, 0.5)
    apart = np.abs(t[:, None] - t)
    noise = sum(sigma**2 * np.exp(-apart / lasts) for sigma, lasts in WANDERS)
    course = 1 - np.exp(-t / (25.0 / 3))
    sees = np.stack([course, np.ones_like(t)], axis=1)
    before = np.diag([RISE**-2, BIAS**-2])
    variance = [
        course[k - 1] ** 2
        * np.linalg.inv(sees[:k].T @ np.linalg.solve(noise[:k, :k], sees[:k]) + before)[0, 0]
        for k in range(1, len(t) + 1)
    ]
    return float(np.sqrt(np.mean(variance)))


def wandering_tip() -> None:
    loop = control()
    without = rms(loop.OFF)
    name = 'standoff.arc_wander_rms_mm'
    emit(name, rms(loop.ARC, True), 'mm', 'no tracking, same seeds', without)
    emit('standoff.arc_wander_bound_mm', least_error(), 'mm', 'wanted by the arc', 0.5)


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


def in_laboratory(
    seeds: range, source: str, cell: dict, layers: int, fault: str = '', **bridge: float
) -> list:
    """Results of the block on the plate; `cell`: parameters of the cell, or seed -> parameters."""
    from waam_lab import Fault, parts, run_many

    with tempfile.TemporaryDirectory() as folder:
        jobs = [
            parts.job(
                Path(folder),
                'block',
                seed,
                layers=layers,
                preset=preset(),
                faults=(Fault(fault),) if fault else (),
                overrides={
                    'cell': cell.get(seed, cell),
                    'bridge': {'standoff_source': source, **bridge},
                },
            )
            for seed in seeds
        ]
        found = run_many(jobs, workers=workers())
    for r in found:
        alarms = [a['text'] for a in r.anomalies if a['text'].startswith('E212')]
        if r.failed or (alarms and not fault):
            text = r.message[:120] if r.failed else '; '.join(alarms)
            print(f'standoff: {source}, seed {r.seed}: {text}', file=sys.stderr)
    return found


def warping_job() -> None:
    def rms(source: str) -> float:
        found = in_laboratory(LAB_SEEDS, source, WARPS, 2)
        each = ', '.join(f'{r.contact_rms * 1e3:.3f}' for r in found)
        worst = max(r.contact_worst for r in found) * 1e3
        print(f'standoff: {source}: {each} mm; largest {worst:.2f} mm', file=sys.stderr)
        return 1e3 * float(np.sqrt(np.mean([r.contact_rms**2 for r in found])))

    without = rms('none')
    for name, source in (('rms_mm', 'laser'), ('rms_arc_mm', 'arc')):
        emit_on_cell(f'standoff.{name}', rms(source), 'mm', 'no tracking, same seeds', without)


def wrong_map(seed: int) -> dict[str, float]:
    rng = np.random.default_rng([seed, 3])
    wrong = {
        'part_moved_z': rng.uniform(-10e-3, 10e-3),
        'part_moved_tilt_x': rng.uniform(-0.02, 0.02),
        'part_moved_tilt_y': rng.uniform(-0.02, 0.02),
        'part_moved_step': 3e-3 * rng.choice([-1.0, 1.0]),
        'part_moved_step_x': rng.uniform(0.03, 0.07),
    }
    return {'arc_contact_min': 4e-3, **{name: float(value) for name, value in wrong.items()}}


def wrong_maps() -> None:
    maps = {seed: wrong_map(seed) for seed in WRONG_MAPS}
    limits = {'standoff_up': 0.012, 'standoff_down': 0.006}
    lost = {}
    for source in ('none', 'laser'):
        found = in_laboratory(WRONG_MAPS, source, maps, 1, **limits)
        lost[source] = sum(r.arcs_lost for r in found)
        none = sum(not r.contact_rms >= 0 for r in found)
        worst = max(r.contact_worst for r in found if r.contact_worst >= 0) * 1e3
        text = f'{source}: {lost[source]} arcs lost, {none} jobs without a second of arc, largest {worst:.2f} mm'
        print(f'standoff: {text}', file=sys.stderr)
    emit_on_cell('standoff.arc_lost', lost['laser'], 'arcs', 'no tracking, same jobs', lost['none'])


def faults_in_the_cell() -> None:
    """Every job has one fault from the first strike on, and a map that is wrong by up to 2 mm."""
    close, least = 0, math.inf
    for fault in ('dead', 'stuck', 'drift', 'inverted', 'unit', 'dropout'):
        cell = {
            seed: {
                **WARPS,
                'part_moved_z': float(np.random.default_rng([seed, 4]).uniform(-2e-3, 0)),
            }
            for seed in FAULT_SEEDS
        }
        found = in_laboratory(FAULT_SEEDS, 'laser', cell, 1, f'distance_{fault}')
        alarms = sum(any(a['text'].startswith('E212') for a in r.anomalies) for r in found)
        nearest = min(r.contact_least for r in found) * 1e3
        ended = sum(r.failed for r in found)
        text = f'{fault}: {len(found)} jobs, {alarms} with an alarm, closest {nearest:.2f} mm, {ended} failed'
        print(f'standoff: {text}', file=sys.stderr)
        close += sum(r.contact_least < 7.5e-3 for r in found)
        least = min(least, nearest)
    emit_on_cell('standoff.cell_too_close', close, 'jobs', 'wanted', 0.0)
    emit_on_cell('standoff.cell_closest_mm', least, 'mm', 'half the contact distance', 7.5)


FIGURES = {
    'standoff.rms_mm': warping_job,
    'standoff.rms_arc_mm': warping_job,
    'standoff.arc_lost': wrong_maps,
    'standoff.cell_too_close': faults_in_the_cell,
    'standoff.cell_closest_mm': faults_in_the_cell,
    'standoff.laser_rms_mm': warping_part,
    'standoff.arc_rms_mm': warping_part,
    'standoff.arc_wander_rms_mm': wandering_tip,
    'standoff.arc_wander_bound_mm': wandering_tip,
    'standoff.step_s': step,
    'standoff.too_close': bad_sensors,
    'standoff.closest_mm': bad_sensors,
}
TABLES = {'standoff.picture': picture}
