"""Scan fusion: speed of the core, speed through ROS, time to the map, accuracy.

scan.core_points_per_s: points per second on 2 cores into 512 x 512 cells of 0.2 mm, poses, validity and the robust
  estimator included, from four sensors of 3200 points at 16 kHz in scanning order. Baselines in the same run on the
  same points, one thread as they are: SciPy binned_statistic_2d (mean) and Open3D voxel down-sampling.
scan.profile_to_map_ms: last profile published to 512 x 512 map received through the real node, by another process, 2
  million points per second, the worst of five.
scan.rms_mm: error of the map of a simulated scan (noise 0.03 mm, 1 % spikes, 5 % drop-outs, cells of 0.25 mm), against
  the plain mean and the exact median per cell.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from lib import scan_surface
from lib.emit import emit

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.stream.poses import PoseTrack
from waam_scan.stream.profiles import ProfileBlock
from waam_scan.stream.session import Session
from waam_scan.transform import Mounting

GRID = GridSpec(0.0, 0.0, 0.2e-3, 512, 512)
# per profile; profiles per batch; profiles per second of four sensors
POINTS, BATCH, RATE = (3200, 2048, 64_000)
SPEED = 0.1  # m/s, travel: the grid takes one second and 2e8 points


def batch(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """x, z (BATCH, POINTS) float32 m: noise 0.03 mm, 1 % spikes, 5 % drop-outs."""
    x = np.tile(np.linspace(-51.2e-3, 51.2e-3, POINTS, dtype=np.float32), (BATCH, 1))
    z = -0.11 + 30e-6 * rng.standard_normal(x.shape, dtype=np.float32)
    chance = rng.random(x.shape, dtype=np.float32)
    z[chance < 0.01] += 5e-3 * rng.random(int((chance < 0.01).sum()), dtype=np.float32)
    z[chance > 0.95] = np.nan
    return x, z.astype(np.float32)


def pose_track(seconds: float) -> PoseTrack:
    """1 kHz of telemetry along x; after every second the travel turns back."""
    track = PoseTrack(200_000)
    for k in range(int(seconds * 1000) + 100):
        t = k * 1e-3
        share = abs((t * SPEED + 0.1) % 0.2 - 0.1)
        track.append(k * 1_000_000, 1.2e-3 + share, 51.2e-3, 0.0)
    return track


def core(batches: int) -> float:
    """Points per second."""
    x, z = batch(np.random.default_rng(0))
    stamps = (np.arange(batches * BATCH) * (1e9 / RATE)).astype(np.int64)
    track = pose_track(batches * BATCH / RATE)
    fusion = Fusion(GRID, Mounting(np.array([0.0, 0.0, 0.11])), threads=2)
    session = Session(fusion, track, max_waiting=10**6)
    began = time.perf_counter()
    for part in stamps.reshape(batches, BATCH):
        session.add(ProfileBlock(part, x, z))
    took = time.perf_counter() - began
    assert session.counts.used == batches * BATCH, session.counts
    return fusion.points / took


def baselines() -> dict[str, float]:
    """Points per second of what others offer, on one batch that is already in work coordinates."""
    import open3d
    from scipy.stats import binned_statistic_2d

    x, z = batch(np.random.default_rng(0))
    px = np.repeat(np.linspace(0.0, 0.1, BATCH), POINTS)
    py, pz = x.ravel().astype(float) + 51.2e-3, z.ravel().astype(float)
    good = np.isfinite(pz)
    px, py, pz = px[good], py[good], pz[good]
    edges = [np.arange(513) * 0.2e-3] * 2
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.column_stack([px, py, pz])))
    actions: dict[str, Callable] = {
        'SciPy binned_statistic_2d mean': lambda: binned_statistic_2d(py, px, pz, 'mean', edges),
        'Open3D voxel down-sampling 0.2 mm': lambda: cloud.voxel_down_sample(0.2e-3),
    }
    found = {}
    for name, action in actions.items():
        began = time.perf_counter()
        action()
        found[name] = len(px) / (time.perf_counter() - began)
    return found


def bench_core() -> None:
    core(2)  # compiled
    value = core(31)
    for name, baseline in baselines().items():
        emit('scan.core_points_per_s', value, 'points/s', name, baseline)


def bench_accuracy() -> None:
    *profiles, cell, height = scan_surface.scan()
    z, sigma = scan_surface.ours(*profiles)
    rms, bias = scan_surface.errors(z)
    true, good = scan_surface.truth()
    ratio = float(np.sqrt(np.nanmean(((z - true) / sigma)[good] ** 2)))
    note = f'bias {bias * 1e3:+.5f} mm, true error / stated uncertainty {ratio:.3f}'
    for name, estimate in (('plain mean per cell', np.mean), ('exact median per cell', np.median)):
        baseline = scan_surface.errors(scan_surface.per_cell(cell, height, estimate))[0]
        emit('scan.rms_mm', rms * 1e3, 'mm', f'{name}; {note}', baseline * 1e3)


def bench_ros() -> None:
    from lib.scan_graph import ScannedNode

    with ScannedNode() as node:
        took = [node.scan() for _ in range(5)]
    said = f'limit; median {np.median(took):.0f} ms'
    emit('scan.profile_to_map_ms', max(took), 'ms', said, 50.0)


FIGURES = {
    'scan.rms_mm': bench_accuracy,
    'scan.core_points_per_s': bench_core,
    'scan.profile_to_map_ms': bench_ros,
}
