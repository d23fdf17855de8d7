"""Registration of scans against what one would do without it, on the same simulated data.

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
SHARES = (0.0, 0.3, 0.7)
MIDDLE = np.array([0.05, 0.05, 0.01])


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
    'registration.error_mm': registration,
    'registration.turn_mdeg': registration,
    'registration.cpu_s': registration,
}
