"""Robots: their programs, the simulated cell with its servos, latency and errors, calibration.

robot.program_path_um: largest distance between the path of the plan and that of its program in three languages, read
back and run on the robot with and without a turning positioner; six parts; baseline: asked for.
robot.cell_speed_error_pct: six beads at 10 mm/s on three cells each, how far the true speed of the torch is off on 99 %
of the way that the arc burns; the worst bead; baseline: the same on the gantry. robot.rms_ratio: RMS height error of
the demo's jaw, mean of five seeds; baseline: the gantry on the same seeds. robot.arc_off_max_ms: a required node, the
bridge or the robot's driver dies at a random moment of a bead, how long the arc burns on at most; baseline: asked for.
`WAAM_BENCH_TRIALS=30` makes fewer than 200 kills.
robot.tcp_mm, robot.hand_eye_mm: calibrations of 40 simulated robots with their stated errors from 10 touches and from
14 profiles of a sphere: median distance of the tip (scanner) found from the true one; baseline: as it was mounted,
2 mm off along every axis. robot.calibration_coverage: share of the coordinates of both that lie within their 95 %
interval; baseline: 0.95.
"""

from __future__ import annotations

import os
import sys

import numpy as np
from lib.emit import emit
from lib.preset import emit_on_cell
from lib.seeds import seeds


def program_paths() -> None:
    """Worst of all parts, languages and positioners, as programs are written by default."""
    from lib.robot_programs import programs

    found = list(programs())
    for post in sorted({f.post for f in found}):
        worst = max((f for f in found if f.post == post), key=lambda f: f.path_um)
        said = f'{worst.path_um:.2f} um ({worst.part}, positioner {worst.positioner})'
        lean = max(f.lean_deg for f in found if f.post == post)
        print(
            f'robot.program_path_um, {post}: {said}, torch within {lean:.4f} deg', file=sys.stderr
        )
    emit('robot.program_path_um', max(f.path_um for f in found), 'um', 'asked for', 10.0)


def cell_speed() -> None:
    """Six beads, two machines, several cells."""
    from lib.robot_cell import PARTS, speed_off

    off = {
        kind: {
            name: [speed_off(kind, make(), seed) for seed in seeds((3, 12, 13))]
            for name, make in PARTS.items()
        }
        for kind in ('gantry', 'robot')
    }
    for name in PARTS:
        said = ', '.join(
            f'{kind} {min(found[name]):.3%} to {max(found[name]):.3%}'
            for kind, found in off.items()
        )
        print(f'robot.cell_speed_error_pct, {name}: {said}', file=sys.stderr)
    worst = {kind: 100 * max(map(max, found.values())) for kind, found in off.items()}
    emit('robot.cell_speed_error_pct', worst['robot'], '%', 'gantry', worst['gantry'])


def cell_rms() -> None:
    """The jaw on both machines."""
    from lib.jaw import jaw_job

    from waam_lab import over_seeds, run_many

    wanted, rms = seeds((1, 2, 3, 7, 11)), {}
    for kind in ('gantry', 'robot'):
        found = run_many(over_seeds(jaw_job(machine=kind), list(wanted)))
        for r in found:
            said = r.message if r.failed else f'{r.rms * 1e3:.4f} mm, {r.share_in_tolerance:.3f}'
            print(f'robot.rms_ratio, {kind}, seed {r.seed}: {said}', file=sys.stderr)
        rms[kind] = float(np.mean([r.rms for r in found])) * 1e3
    emit_on_cell('robot.rms_ratio', rms['robot'] / rms['gantry'], '1', 'gantry', 1.0)


def cell_kills() -> None:
    """Kills at random moments."""
    from lib.robot_cell import KINDS, kill

    count = int(os.environ.get('WAAM_BENCH_TRIALS', '200'))
    rng = np.random.default_rng(seeds((5,))[0])
    off_ms = [1e3 * kill(KINDS[n % 3], rng.uniform(0.0, 12.0), 100 + n) for n in range(count)]
    for k, what in enumerate(KINDS):
        off = off_ms[k::3] or [float('nan')]
        said = f'{np.median(off):.0f} ms in the middle, {max(off):.0f} at most'
        print(f'robot.arc_off_max_ms, {what}: {len(off)} kills, {said}', file=sys.stderr)
    emit('robot.arc_off_max_ms', max(off_ms), 'ms', 'asked for', 500.0)


def calibrated() -> None:
    """Forty robots."""
    from lib.robot_cell import calibrations

    found = calibrations(seeds(tuple(range(1, 41))))
    before = 2.0 * 1.538  # median length of three normal numbers
    for what, name in (('touches', 'robot.tcp_mm'), ('profiles', 'robot.hand_eye_mm')):
        off = found[what][:, 3] * 1e3
        x, y, z = (np.abs(found[what][:, :3]) < 1).mean(axis=0)
        print(
            f'{name}: {off.min():.3f} to {off.max():.3f} mm; within the interval x {x:.1%}, y {y:.1%}, z {z:.1%}',
            file=sys.stderr,
        )
        emit(name, float(np.median(off)), 'mm', 'as mounted', before)
    inside = np.abs(np.concatenate([v[:, :3] for v in found.values()])) < 1
    emit('robot.calibration_coverage', float(inside.mean()), '1', 'stated', 0.95)


FIGURES = {
    'robot.program_path_um': program_paths,
    'robot.cell_speed_error_pct': cell_speed,
    'robot.rms_ratio': cell_rms,
    'robot.arc_off_max_ms': cell_kills,
    'robot.tcp_mm': calibrated,
    'robot.hand_eye_mm': calibrated,
    'robot.calibration_coverage': calibrated,
}
