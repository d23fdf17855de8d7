"""Calibration and registration of scans against what one would do without them, on the same simulated data.

scan.calibration_mm: largest error of the scanner's position over all seeds (baseline: tape measure and one pass:
rotation from the drawing, no time offset, middle of the artefact put where it stands). Angle and time go to stderr.
registration.error_mm: largest error of the middle of the surface after a drift of 0.3 mm and 0.1 deg, while 0, 30 and
70 % of it were covered with 2 mm of metal (baselines: plain Open3D point-to-plane, the same with Tukey's kernel of
0.2 mm, and KISS-ICP, on the same data). registration.turn_mdeg: largest error of the rotation in the same runs.
registration.cpu_s: processor time of one registration. The table for docs/registration.md goes to stderr.
WAAM_BENCH_COUNT: seeds for each (default 3; about half a minute of processor time per seed).
"""

from __future__ import annotations

import os
import sys
import time

import numpy as np
from lib.emit import emit
from lib.paths import SOURCES

sys.path.insert(0, str(SOURCES / 'waam_scan' / 'test'))
SEEDS = range(int(os.environ.get('WAAM_BENCH_COUNT', '3')))
PLACE, TOP, HEIGHT = (0.10, 0.06, 0.0), (0.020, 0.014), 0.012
SLOPES = (np.radians(45), np.radians(40))
SHARES = (0.0, 0.3, 0.7)
MIDDLE = np.array([0.05, 0.05, 0.01])


def calibration() -> None:
    """Random mountings (5 mm, 3 deg, 30 ms off the drawing), step block, noise 0.03 mm, 1 % spikes, 5 % drop-outs."""
    import calibration_sim as sim

    from waam_scan.calibration.artefact import Artefact, Block
    from waam_scan.calibration.robust import turn_vector
    from waam_scan.calibration.solve import calibrate

    world = sim.block_world(TOP, HEIGHT, SLOPES, PLACE, 0.0)
    artefact = Artefact(Block.of(TOP, HEIGHT, SLOPES), np.array(PLACE))
    errors, naive = [], []
    for seed in SEEDS:
        rng = np.random.default_rng(1000 + seed)
        offset = np.array([0.060, 0.0, 0.120]) + rng.uniform(-5e-3, 5e-3, 3)
        rpy = np.radians([0, 0, 90]) + np.radians(rng.uniform(-3, 3, 3))
        delay = rng.uniform(-0.03, 0.03)
        passes = sim.passes_over(world, PLACE[:2], offset, rpy, delay, rng)
        m = calibrate(passes, artefact).mounting
        turn = turn_vector(m.rotation @ sim.quaternion_matrix(rpy).T)
        errors.append(
            (
                1e3 * np.linalg.norm(m.offset - offset),
                np.degrees(np.linalg.norm(turn)),
                1e3 * abs(m.delay - delay),
            )
        )
        naive.append(1e3 * np.linalg.norm(tape_measure(passes[0]) - offset))
    worst = np.max(errors, axis=0)
    print(
        f'calibration, worst of {len(errors)}: {worst[0]:.4f} mm, {worst[1]:.4f} deg, {worst[2]:.4f} ms',
        file=sys.stderr,
    )
    emit(
        'scan.calibration_mm',
        float(worst[0]),
        'mm',
        'tape measure and one pass',
        float(np.max(naive)),
    )


def tape_measure(scan) -> np.ndarray:
    """(3,) m: the drawing's rotation, stamps as they are, the upper half of the artefact put where it stands."""
    from waam_scan.transform import Mounting

    tcp = np.column_stack(
        [np.interp(scan.stamps, scan.pose_stamps, scan.poses[:, i]) for i in range(3)]
    )
    drawing = Mounting()
    p = drawing.points(tcp, scan.x, scan.z).reshape(-1, 3)
    p = p[np.isfinite(p).all(axis=1)]
    table = np.median(p[:, 2])
    high = p[p[:, 2] > table + HEIGHT / 2]
    seen = np.array([high[:, 0].mean(), high[:, 1].mean(), table])
    return drawing.offset + np.array(PLACE) - seen


def registration() -> None:
    """Every method on the same pairs."""
    import registration_sim as sim

    methods = {
        'waam_scan': ours,
        'Open3D point-to-plane': lambda b, a: open3d_icp(b, a, None),
        'Open3D + Tukey 0.2 mm': lambda b, a: open3d_icp(b, a, 0.2),
        'KISS-ICP': kiss,
    }
    errors = {(m, s): [] for m in methods for s in SHARES}
    seconds = dict.fromkeys(methods, 0.0)
    for seed in SEEDS:
        for share in SHARES:
            rng = np.random.default_rng(2000 + seed)
            rotation, translation = sim.drift(rng)
            reference = sim.scan(sim.shaped, rng)
            moved = sim.scan(sim.shaped, rng, share=share) @ rotation.T + translation
            for name, method in methods.items():
                start = time.process_time()
                found = method(moved, reference)
                seconds[name] += time.process_time() - start
                shift, turn = sim.error(found[:3, :3], found[:3, 3], rotation, translation)
                errors[name, share].append(
                    (1e3 * np.linalg.norm(shift), np.degrees(np.linalg.norm(turn)))
                )
    report(methods, errors, seconds, len(SEEDS))
    runs = len(SEEDS) * len(SHARES)
    for name, unit, figure in (
        ('registration.error_mm', 'mm', lambda m: _worst(errors, m, 0)),
        ('registration.turn_mdeg', 'mdeg', lambda m: 1e3 * _worst(errors, m, 1)),
        ('registration.cpu_s', 's', lambda m: seconds[m] / runs),
    ):
        for baseline in list(methods)[1:]:
            emit(name, figure('waam_scan'), unit, f'{baseline}, same data', figure(baseline))


def _worst(errors, method: str, column: int) -> float:
    return max(e[column] for share in SHARES for e in errors[method, share])


def report(methods, errors, seconds, count: int) -> None:
    """Mean errors as a table (um / mdeg)."""
    print(
        '| um / mdeg | ' + ' | '.join(f'+2 mm on {s:.0%}' for s in SHARES) + ' | CPU s |',
        file=sys.stderr,
    )
    for m in methods:
        cells = [np.mean(errors[m, s], axis=0) * 1e3 for s in SHARES]
        text = ' | '.join(f'{c[0]:.1f} / {c[1]:.1f}' for c in cells)
        print(f'| {m} | {text} | {seconds[m] / count / len(SHARES):.1f} |', file=sys.stderr)


def ours(moved: np.ndarray, reference: np.ndarray) -> np.ndarray:
    from waam_scan.registration.solve import register

    return register(moved, reference).matrix


def open3d_icp(moved: np.ndarray, reference: np.ndarray, tukey_mm: float | None) -> np.ndarray:
    """Legacy pipeline in mm about the middle: voxel 0.5 mm, normals, point-to-plane with 2 mm reach."""
    import open3d as o3d

    clouds = []
    for points in (moved, reference):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((points - MIDDLE) * 1e3))
        cloud = cloud.voxel_down_sample(0.5)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2.0, 30))
        clouds.append(cloud)
    reg = o3d.pipelines.registration
    kernel = reg.TukeyLoss(tukey_mm) if tukey_mm else reg.L2Loss()
    found = reg.registration_icp(
        *clouds, 2.0, np.eye(4), reg.TransformationEstimationPointToPlane(kernel),
        reg.ICPConvergenceCriteria(1e-9, 1e-9, 100),
    )  # fmt: skip
    return back_to_metres(found.transformation, MIDDLE)


def kiss(moved: np.ndarray, reference: np.ndarray) -> np.ndarray:
    from waam_scan.registration.odometry import coarse_poses

    return coarse_poses([reference, moved], 0.5e-3)[1]


def back_to_metres(matrix: np.ndarray, centre: np.ndarray) -> np.ndarray:
    m = matrix.copy()
    m[:3, 3] = m[:3, 3] * 1e-3 + centre - m[:3, :3] @ centre
    return m


FIGURES = {
    'scan.calibration_mm': calibration,
    'registration.error_mm': registration,
    'registration.turn_mdeg': registration,
    'registration.cpu_s': registration,
}
