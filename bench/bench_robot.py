"""Robot arm and positioner: kinematics and motion split.

robot.ik_error_m: largest deviation of the wire-tip pose over 10^5 random poses and all their branches (positions in m,
unit axes beside them); baseline: asked for.
robot.ik_us: processor time per pose for all eight branches; baseline: Pinocchio's iterative inverse called from Python
as its documentation does, one solution from a start 0.3 rad away. Its share of solved poses goes to stderr.
robot.table_deg: largest deviation from table 2.2 of source 003 in degrees; robot.table_mm: from its forward values and
table 3.4; baselines: asked for.
On the simulated robot cell of the laboratory, with its servos, latency and errors:
robot.cell_speed_error_pct: six beads at 10 mm/s on three cells each, how far the true speed of the torch is off on 99 %
of the way that the arc burns; the worst bead; baseline: the same on the gantry. robot.rms_ratio: RMS height error of
the demo's jaw, mean of five seeds; baseline: the gantry on the same seeds. robot.arc_off_max_ms: a required node, the
bridge or the robot's driver dies at a random moment of a bead, how long the arc burns on at most; baseline: asked for.
`WAAM_BENCH_TRIALS=30` makes fewer than 200 kills.

robot.tcp_mm, robot.hand_eye_mm: calibrations of 40 simulated robots with their stated errors from 10 touches and from
14 profiles of a sphere: median distance of the tip (scanner) found from the true one; baseline: as it was mounted,
2 mm off along every axis. robot.calibration_coverage: share of the coordinates of both that lie within their 95 %
interval; baseline: 0.95.

robot.turning_m: longest box of 0.12 x 0.1 m over the turn axis that the arm serves at least 15 deg off a stretched
wrist, the part turning as `turn_choice` has it; baseline: the part at rest. robot.overhang_deg: steepest arm on a post
that is built with the part tilted (60, 70, 80, 85, 90 degrees, in the laboratory, seeds 3, 7, 11) with at most 0.3 mm
RMS and no contact of arm or torch in its plan; baseline: the limit of the planner on a level part.
"""

from __future__ import annotations

import sys

from lib.emit import emit
from lib.preset import emit_on_cell
from lib.seeds import seeds

POSES, SOME = 100_000, 1000
WANTED = 0.001


def inverse() -> None:
    """All branches of many poses; some of them by Pinocchio."""
    from lib.robot_cases import analytic, iterative

    error, taken = analytic(POSES)
    emit('robot.ik_error_m', error * 1e9, 'nm', 'asked for', 1.0)
    try:
        slow, share = iterative(SOME)
    except ImportError as e:
        print(
            f'robot.ik_us: no baseline ({e}); scripts/setup.sh --robot installs it', file=sys.stderr
        )
        emit('robot.ik_us', taken, 'us', 'Pinocchio is not installed', None)
        return
    print(f'Pinocchio solved {share:.1%} of {SOME} poses', file=sys.stderr)
    emit('robot.ik_us', taken, 'us', "Pinocchio's iterative inverse", slow)


def tables() -> None:
    """The printed values of the source."""
    from lib.robot_cases import table_errors

    found = table_errors()
    emit('robot.table_deg', found['table_2_2_deg'], 'deg', 'asked for', WANTED)
    emit(
        'robot.table_mm', max(found['forward_mm'], found['table_3_4_mm']), 'mm', 'asked for', WANTED
    )


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
    import numpy as np
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
    import os

    import numpy as np
    from lib.robot_cell import KINDS, kill

    count = int(os.environ.get('WAAM_BENCH_TRIALS', '200'))
    rng = np.random.default_rng(seeds((5,))[0])
    found = [kill(KINDS[n % 3], rng.uniform(0.0, 12.0), 100 + n) for n in range(count)]
    for what in KINDS:
        off = [k.off * 1e3 for k in found if k.what == what] or [float('nan')]
        said = f'{np.median(off):.0f} ms in the middle, {max(off):.0f} at most'
        print(f'robot.arc_off_max_ms, {what}: {len(off)} kills, {said}', file=sys.stderr)
    emit('robot.arc_off_max_ms', 1e3 * max(k.off for k in found), 'ms', 'asked for', 500.0)


def calibrated() -> None:
    """Forty robots."""
    import numpy as np
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


def turned() -> None:
    """Longest boxes, 0.12 m wide and 0.1 m high, over the turn axis."""
    from lib.robot_cell import longest

    still, turning, said = longest()
    print(f'robot.turning_m: {said}', file=sys.stderr)
    emit('robot.turning_m', turning, 'm', 'the part at rest', still)


def overhangs() -> None:
    """Arms on a post."""
    import tempfile
    from pathlib import Path

    from lib.robot_overhang import build

    from waam_plan.settings import PlanSettings

    best = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for degrees in (60.0, 70.0, 80.0, 85.0, 90.0):
            walls = [build(degrees, seed, Path(folder)) for seed in seeds((3, 7, 11))]
            said = '; '.join(f'{w.said}, {w.contacts} contacts' for w in walls)
            print(f'robot.overhang_deg, {degrees:g} deg: {said}', file=sys.stderr)
            if all(w.rms <= 0.3e-3 and not w.contacts for w in walls):
                best = degrees
    emit_on_cell('robot.overhang_deg', best, 'deg', 'level', PlanSettings().overhang_limit_deg)


FIGURES = {
    'robot.turning_m': turned,
    'robot.overhang_deg': overhangs,
    'robot.tcp_mm': calibrated,
    'robot.hand_eye_mm': calibrated,
    'robot.calibration_coverage': calibrated,
    'robot.ik_error_m': inverse,
    'robot.ik_us': inverse,
    'robot.table_deg': tables,
    'robot.table_mm': tables,
    'robot.cell_speed_error_pct': cell_speed,
    'robot.rms_ratio': cell_rms,
    'robot.arc_off_max_ms': cell_kills,
}
