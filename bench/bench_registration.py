"""Calibration and registration of scans against what one would do without them, on the same simulated data.

scan.calibration_mm: largest error of the scanner's position over all seeds (baseline: tape measure and one pass:
rotation from the drawing, no time offset, middle of the artefact put where it stands). Angle and time go to stderr.
registration.error_mm: largest error of the middle of the surface after a drift of 0.3 mm and 0.1 deg, while 0, 30 and
70 % of it were covered with 2 mm of metal (baseline: Open3D point-to-plane with Tukey's kernel of 0.2 mm, on the same
data). registration.turn_mdeg: largest error of the rotation in the same runs.
registration.cpu_s: processor time of one registration.
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
        shift, angle = np.linalg.norm(m.offset - offset), np.degrees(np.linalg.norm(turn))
        errors.append((1e3 * shift, angle, 1e3 * abs(m.delay - delay)))
        naive.append(1e3 * np.linalg.norm(tape_measure(passes[0]) - offset))
    worst = np.max(errors, axis=0)
    said = ', '.join(f'{v:.4f} {u}' for v, u in zip(worst, ('mm', 'deg', 'ms'), strict=True))
    print(f'calibration, worst of {len(errors)}: {said}', file=sys.stderr)
    emit('scan.calibration_mm', worst[0], 'mm', 'tape measure and one pass', max(naive))


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
    """Both methods on the same pairs."""
    import registration_sim as sim

    from waam_scan.registration.solve import register

    methods = {
        'ours': lambda moved, reference: register(moved, reference).matrix,
        'Open3D': open3d_icp,
    }
    rows: dict[str, list] = {m: [] for m in methods}
    for seed in SEEDS:
        for share in SHARES:
            rng = np.random.default_rng(2000 + seed)
            rotation, translation = sim.drift(rng)
            reference = sim.scan(sim.shaped, rng)
            moved = sim.scan(sim.shaped, rng, share=share) @ rotation.T + translation
            for name, method in methods.items():
                start = time.process_time()
                found = method(moved, reference)
                took = time.process_time() - start
                off = sim.error(found[:3, :3], found[:3, 3], rotation, translation)
                shift, turn = (float(np.linalg.norm(v)) for v in off)
                rows[name].append((1e3 * shift, 1e3 * np.degrees(turn), took))
    ours, theirs = (np.array(rows[m]) for m in methods)
    said = 'Open3D + Tukey 0.2 mm, same data'
    emit('registration.error_mm', ours[:, 0].max(), 'mm', said, theirs[:, 0].max())
    emit('registration.turn_mdeg', ours[:, 1].max(), 'mdeg', said, theirs[:, 1].max())
    emit('registration.cpu_s', ours[:, 2].mean(), 's', said, theirs[:, 2].mean())


def open3d_icp(moved: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Legacy pipeline in mm about the middle: voxel 0.5 mm, normals, point-to-plane with 2 mm reach."""
    import open3d as o3d

    clouds = []
    for points in (moved, reference):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((points - MIDDLE) * 1e3))
        cloud = cloud.voxel_down_sample(0.5)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2.0, 30))
        clouds.append(cloud)
    reg = o3d.pipelines.registration
    found = reg.registration_icp(
        *clouds, 2.0, np.eye(4), reg.TransformationEstimationPointToPlane(reg.TukeyLoss(0.2)),
        reg.ICPConvergenceCriteria(1e-9, 1e-9, 100),
    )  # fmt: skip
    m = found.transformation.copy()
    m[:3, 3] = m[:3, 3] * 1e-3 + MIDDLE - m[:3, :3] @ MIDDLE
    return m


FIGURES = {
    'scan.calibration_mm': calibration,
    'registration.error_mm': registration,
    'registration.turn_mdeg': registration,
    'registration.cpu_s': registration,
}
