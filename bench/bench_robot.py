"""Robot arm and positioner: kinematics and motion split.

robot.ik_error_m: largest deviation of the wire-tip pose over 10^5 random poses and all their branches (positions in m,
unit axes beside them); baseline: asked for.
robot.ik_us: processor time per pose for all eight branches; baseline: Pinocchio's iterative inverse called from Python
as its documentation does, one solution from a start 0.3 rad away. Its share of solved poses goes to stderr.
robot.table_deg: largest deviation from table 2.2 of source 003 in degrees; robot.table_mm: from its forward values and
table 3.4; baselines: asked for.
robot.oval_error_ratio: oval of 500 mm with 5 % ovality, largest miss of the wire tip, split over robot alone, mean of
20 machines with errors in every axis (waam_robot/accuracy.py), program taught at its first point; baseline: the
source's 0.16 / 0.36 mm. robot.oval_untaught_ratio: the same without teaching, where the split cannot help.
robot.flips_in_bead: beads of 500 random parts of two beads whose joint path changes the side of shoulder, elbow or
wrist or jumps, judged by the places of the links; parts that were refused go to stderr; baseline: asked for.
robot.wide_refused: of 200 random level parts within 0.8 m of the turn axis, how many are refused; baseline: with the
usual turn of the positioner alone.
robot.collisions: 500 random parts of three beads whose joint path and ways between the beads are planned without
contacts (arm, torch, positioner, beads laid before), judged by points, plain distances and Pinocchio's frames: parts in
which something touches; baseline: asked for. How many were refused, for how many of these the second method agrees, the
least distances, and in how many of 20 ways it finds a contact that was put there go to stderr; without all 20 there is
no figure.
robot.speed_error_pct: six parts at 10 mm/s, how far the torch's speed at the part is off on 99 % of the way, by forward
kinematics of arm and positioner; the worst part; baseline: asked for. robot.plan_ms_per_point: time of their
joint paths with branches, collisions and timing, per point (every 0.1 mm of bead); baseline: asked for.

robot.program_path_um: programs for Fanuc, KUKA and ABB of six planned parts, without positioner and with one that
turns, read back and run on arm and positioner: largest distance between the path with the arc on and that of the plan;
baseline: asked for. robot.program_rounded_um: the same with a tolerance of 20 um and corners rounded off by 200 um;
baseline: their sum. Torch and file sizes go to stderr.

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

robot.bend_mm: RMS by which the pose errors of 40 simulated robots bend a map of 80 x 60 mm, from their true poses;
baseline: as `waam plan --machine robot` predicts it from the stated errors. robot.bend_left_mm: RMS of what is left of
it (beyond a plane) when it is estimated from the known surface around the map; robot.map_off_mm: the same with height
and slope, which may be those of the part; baselines: before. robot.turning_m: longest box of 0.12 x 0.1 m over the turn
axis that the arm serves at least 15 deg off a stretched wrist, the part turning as `turn_choice` has it; baseline: the
part at rest. robot.posture_step_mm: RMS by which a place lies higher or lower when the torch is brought there with the
positioner turned by 30 degrees from where the robot was taught, 40 robots; baseline: tolerance of the demo's jaw.
robot.overhang_deg: steepest arm on a post
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


def ovals() -> None:
    """Twenty machines."""
    from lib.robot_cases import oval

    found = oval(seeds(tuple(range(1, 21))))
    for taught, name in ((True, 'robot.oval_error_ratio'), (False, 'robot.oval_untaught_ratio')):
        alone, both = found[taught].mean(axis=0)
        worst = (found[taught][:, 1] / found[taught][:, 0]).max()
        print(
            f'{name}: {alone * 1e3:.3f} mm alone, {both * 1e3:.3f} mm split, worst machine {worst:.2f}',
            file=sys.stderr,
        )
        emit(name, both / alone, '1', 'source 003: 0.16 / 0.36 mm', 0.16 / 0.36)


def random_plans() -> None:
    """500 random parts."""
    from lib.robot_parts import random_parts

    flipped, planned, refused = random_parts(500)
    print(f'robot.flips_in_bead: {planned} planned, {len(refused)} refused', file=sys.stderr)
    for text in refused[:3]:
        print(f'  {text}', file=sys.stderr)
    emit('robot.flips_in_bead', float(flipped), '1', 'asked for', 0.0)


def wide_plans() -> None:
    """200 random level parts far from the turn axis."""
    from lib.robot_parts import wide_parts

    (usual, _), (refused, flipped) = (wide_parts(200, turns) for turns in (1, 8))
    print(f'robot.wide_refused: {flipped} flips', file=sys.stderr)
    emit('robot.wide_refused', float(refused), '1', 'usual turn', float(usual))


def collisions() -> None:
    """500 random parts, checked by a second method."""
    from lib.robot_collisions import run

    found = run(500, seeds((17,))[0])
    print(
        f'robot.collisions: {found.planned} planned, {found.refused} refused ({found.contacts} for a contact, '
        f'{found.confirmed} of them too near by the second method as well), least distance '
        f'{found.nearest * 1e3:.2f} mm in beads and {found.apart * 1e3:.2f} mm on {found.ways} ways between them, '
        f'{len(found.no_way)} without such a way, {found.seconds / found.points * 1e3:.3f} ms per point; '
        f'{found.caught} of {found.planted} planted contacts found',
        file=sys.stderr,
    )
    for text in [*found.touching[:5], *found.no_way[:5]]:
        print(f'  {text}', file=sys.stderr)
    if not 0 < found.planted == found.caught:
        raise SystemExit('robot.collisions: the second method misses contacts that were put there')
    emit('robot.collisions', float(len(found.touching)), '1', 'asked for', 0.0)


def plans() -> None:
    """Six parts."""
    from lib.robot_parts import PARTS, run

    from waam_robot.joint_path import Machine

    machine, results = Machine(), []
    try:
        run(PARTS['pad']()[:1], machine)  # loads toppra
    except ValueError as e:
        print(f'robot.speed_error_pct: {e}; scripts/setup.sh --robot does it', file=sys.stderr)
        return
    for name, make in PARTS.items():
        r = run(make(), machine)
        results.append(r)
        print(
            f'{name}: {r.points} points, {r.seconds / r.points * 1e3:.3f} ms each, 99 % of the way within '
            f'{r.off:.3%}, {r.told:.2%} told to be slower, limits used {r.used:.2f}',
            file=sys.stderr,
        )
    emit('robot.speed_error_pct', 100 * max(r.off for r in results), '%', 'asked for', 1.0)
    per_point = sum(r.seconds for r in results) / sum(r.points for r in results) * 1e3
    emit('robot.plan_ms_per_point', per_point, 'ms', 'asked for', 2.0)


def program_paths(name: str, corner: float, tolerance: float, wanted: float) -> None:
    """Worst of all parts, languages and positioners."""
    from lib.robot_programs import programs

    found = list(programs(corner, tolerance))
    for post in sorted({f.post for f in found}):
        some = [f for f in found if f.post == post]
        worst = max(some, key=lambda f: f.path_um)
        print(
            f'{name}, {post}: {worst.path_um:.2f} um ({worst.part}, positioner {worst.positioner}), torch within '
            f'{max(f.lean_deg for f in some):.4f} deg, {sum(f.size for f in some) / 1e6:.1f} MB in all',
            file=sys.stderr,
        )
    emit(name, max(f.path_um for f in found), 'um', 'asked for', wanted)


def exact_programs() -> None:
    """As they are written by default."""
    from waam_plan.robot.cell import RobotCell
    from waam_plan.robot.motion import TOLERANCE

    program_paths('robot.program_path_um', RobotCell().corner, TOLERANCE, 10.0)


def rounded_programs() -> None:
    """Corners rounded off for speed."""
    program_paths('robot.program_rounded_um', 0.2e-3, 0.02e-3, 220.0)


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


def bent() -> None:
    """Forty robots."""
    from lib.robot_cell import bends

    measured, told = bends(seeds(tuple(range(1, 41))))
    emit('robot.bend_mm', measured * 1e3, 'mm', 'predicted', told * 1e3)


def bent_found() -> None:
    """Forty robots, their maps known around the worn place."""
    from lib.robot_cell import bends_found

    found = bends_found(seeds(tuple(range(1, 41))))
    print(
        f'robot.bend_left_mm: {found["inside"]:.1%} within 2 standard deviations', file=sys.stderr
    )
    emit('robot.bend_left_mm', found['left'] * 1e3, 'mm', 'as measured', found['bent'] * 1e3)
    emit('robot.map_off_mm', found['off_left'] * 1e3, 'mm', 'as measured', found['off'] * 1e3)


def turned() -> None:
    """Longest boxes, 0.12 m wide and 0.1 m high, over the turn axis."""
    from lib.robot_cell import longest

    still, turning, said = longest()
    print(f'robot.turning_m: {said}', file=sys.stderr)
    emit('robot.turning_m', turning, 'm', 'the part at rest', still)


def posture_steps() -> None:
    """Forty robots."""
    import numpy as np
    from lib.robot_cell import shifts

    numbers = seeds(tuple(range(1, 41)))
    for turn, spin in ((10, 0), (30, 0), (0, 10), (0, 30), (30, 30)):
        side, up = shifts(numbers, *np.radians([float(turn), float(spin)]))
        print(
            f'robot.posture_step_mm: positioner {turn} deg, torch {spin} deg: {side * 1e3:.3f} mm to the side, '
            f'{up * 1e3:.3f} mm up',
            file=sys.stderr,
        )
    up = shifts(numbers, np.radians(30.0), 0.0)[1]
    emit('robot.posture_step_mm', up * 1e3, 'mm', 'tolerance of the jaw', 0.2)


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
    'robot.bend_mm': bent,
    'robot.bend_left_mm': bent_found,
    'robot.map_off_mm': bent_found,
    'robot.turning_m': turned,
    'robot.posture_step_mm': posture_steps,
    'robot.overhang_deg': overhangs,
    'robot.tcp_mm': calibrated,
    'robot.hand_eye_mm': calibrated,
    'robot.calibration_coverage': calibrated,
    'robot.ik_error_m': inverse,
    'robot.ik_us': inverse,
    'robot.table_deg': tables,
    'robot.table_mm': tables,
    'robot.oval_error_ratio': ovals,
    'robot.oval_untaught_ratio': ovals,
    'robot.flips_in_bead': random_plans,
    'robot.wide_refused': wide_plans,
    'robot.collisions': collisions,
    'robot.speed_error_pct': plans,
    'robot.plan_ms_per_point': plans,
    'robot.program_path_um': exact_programs,
    'robot.program_rounded_um': rounded_programs,
    'robot.cell_speed_error_pct': cell_speed,
    'robot.rms_ratio': cell_rms,
    'robot.arc_off_max_ms': cell_kills,
}
