"""Scan fusion: speed of the core, speed through ROS, time to the map, accuracy.

scan.core_points_per_s: points per second on 2 cores into 512 x 512 cells of 0.2 mm, poses, validity and the robust
  estimator included, from four sensors of 3200 points at 16 kHz; points in scanning order, with the profiles shuffled,
  and with the points of every profile shuffled too. Baselines in the same run on the same order, one thread as they
  are: SciPy binned_statistic_2d (mean) and Open3D voxel down-sampling. Wall time on an idle machine; WAAM_BENCH_CPU=1
  takes 2 x points per CPU second instead (on a busy one), and the line says so.
scan.memory_mb: peak memory of the process after 31 times the points, against after the first batch.
scan.ros_points_per_s: the most points per second from a publisher process through ProfileBatch messages into the real
  node with nothing lost (baseline: the rate that was asked for); the line also tells what the node's process used of
  a core per point and how much memory it holds. WAAM_BENCH_ROS_S: seconds per rate (default 3).
scan.profile_to_map_ms: last profile published to 512 x 512 map received, by another process, worst of the runs.
scan.rms_mm: error of the map of a simulated scan (noise 0.03 mm, 1 % spikes, 5 % drop-outs, cells of 0.25 mm), against
  the plain mean and the exact median per cell.
Table, only when asked for by name: scan.estimators compares ways to make one height of the points of a cell.
"""

from __future__ import annotations

import os
import resource
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
CPU = os.environ.get('WAAM_BENCH_CPU') == '1'


def batch(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """x, z (BATCH, POINTS) float32 m: noise 0.03 mm, 1 % spikes, 5 % drop-outs."""
    x = np.tile(np.linspace(-51.2e-3, 51.2e-3, POINTS, dtype=np.float32), (BATCH, 1))
    z = -0.11 + 30e-6 * rng.standard_normal(x.shape, dtype=np.float32)
    chance = rng.random(x.shape, dtype=np.float32)
    z[chance < 0.01] += 5e-3 * rng.random(int((chance < 0.01).sum()), dtype=np.float32)
    z[chance > 0.95] = np.nan
    return x, z.astype(np.float32)


def shuffled(rng: np.random.Generator, *arrays: np.ndarray) -> list[np.ndarray]:
    """The values of equal arrays in a common random order."""
    places = rng.permutation(arrays[0].size)
    return [a.ravel()[places].reshape(a.shape) for a in arrays]


def pose_track(seconds: float) -> PoseTrack:
    """1 kHz of telemetry along x; after every second the travel turns back."""
    track = PoseTrack(200_000)
    for k in range(int(seconds * 1000) + 100):
        t = k * 1e-3
        share = abs((t * SPEED + 0.1) % 0.2 - 0.1)
        track.append(k * 1_000_000, 1.2e-3 + share, 51.2e-3, 0.0)
    return track


def core(order: str, batches: int) -> tuple[float, float]:
    """Points per second of wall time and per second of CPU time. order: scanning, profiles, points."""
    rng = np.random.default_rng(0)
    x, z = batch(rng)
    if order == 'points':
        x, z = shuffled(rng, x, z)
    stamps = (np.arange(batches * BATCH) * (1e9 / RATE)).astype(np.int64)
    if order != 'scanning':
        rng.shuffle(stamps)
    track = pose_track(batches * BATCH / RATE)
    fusion = Fusion(GRID, Mounting(np.array([0.0, 0.0, 0.11])), threads=2)
    session = Session(fusion, track, max_waiting=10**6)
    wall, cpu = time.perf_counter(), time.process_time()
    for part in stamps.reshape(batches, BATCH):
        session.add(ProfileBlock(part, x, z))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    assert session.counts.used == batches * BATCH, session.counts
    return fusion.points / wall, fusion.points / cpu


def baselines(order: str) -> dict[str, float]:
    """Points per second of what others offer, on one batch that is already in work coordinates and in that order."""
    import open3d
    from scipy.stats import binned_statistic_2d

    rng = np.random.default_rng(0)
    x, z = batch(rng)
    travel = np.linspace(0.0, 0.1, BATCH)
    if order != 'scanning':
        rng.shuffle(travel)
    px = np.repeat(travel, POINTS)
    if order == 'points':
        x, z = shuffled(rng, x, z)
    py, pz = x.ravel().astype(float) + 51.2e-3, z.ravel().astype(float)
    good = np.isfinite(pz)
    px, py, pz = px[good], py[good], pz[good]
    edges = [np.arange(513) * 0.2e-3] * 2
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.column_stack([px, py, pz])))
    actions: dict[str, Callable] = {
        'SciPy binned_statistic_2d mean': lambda: binned_statistic_2d(py, px, pz, 'mean', edges),
        'Open3D voxel down-sampling 0.2 mm': lambda: cloud.voxel_down_sample(0.2e-3),
    }
    return {name: len(px) / _seconds(action) for name, action in actions.items()}


def _seconds(action: Callable) -> float:
    clock = time.process_time if CPU else time.perf_counter
    started = clock()
    action()
    return clock() - started


def bench_core() -> None:
    core('scanning', 2)  # compiled
    for order in ('scanning', 'profiles', 'points'):
        wall, cpu = core(order, 31)
        value = 2 * cpu if CPU else wall
        how = '2 x per CPU second' if CPU else 'wall time'
        for name, baseline in baselines(order).items():
            emit(
                'scan.core_points_per_s', value, 'points/s',
                f'{name}; input: {order} order{" shuffled" * (order != "scanning")}; {how}', baseline,
            )  # fmt: skip


def bench_memory() -> None:
    core('scanning', 1)
    before = peak_mb()
    core('scanning', 31)
    after = peak_mb()
    emit('scan.memory_mb', after, 'MB', 'peak of the process after one batch instead of 31', before)


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def bench_accuracy() -> None:
    s = scan_surface.scan()
    z, sigma, _ = scan_surface.ours(s)
    rms, bias = scan_surface.errors(z)
    true, good = scan_surface.truth()
    ratio = float(np.sqrt(np.nanmean(((z - true) / sigma)[good] ** 2)))
    note = f'bias {bias * 1e3:+.5f} mm, true error / stated uncertainty {ratio:.3f}'
    for name, other in (
        ('plain mean per cell', scan_surface.mean(s)[0]),
        (
            'exact median per cell',
            scan_surface.of_all_points(s, lambda h: float(np.median(h)))[0],
        ),
    ):
        baseline = scan_surface.errors(other)[0]
        emit('scan.rms_mm', rms * 1e3, 'mm', f'{name}; {note}', baseline * 1e3)


def bench_ros() -> None:
    from lib import scan_graph

    seconds = float(os.environ.get('WAAM_BENCH_ROS_S', '3'))
    with scan_graph.Graph() as graph:
        best, cause, latencies, held, cost = 0.0, '', [], [], 0.0
        for rate in (0.5e7, 1e7, 1.5e7, 2e7, 2.5e7, 3e7, 4e7, 6e7):
            run = graph.scan(rate, seconds)
            held.append(run.memory_mb)
            if run.lost:
                cause = f'at {rate:.1e} asked: {run.why}'
                break
            latencies.append(run.latency_ms)
            best, cost = max(best, run.rate), run.ns_per_point
        emit(
            'scan.ros_points_per_s', best, 'points/s',
            f'limit; nothing lost; {cause or "highest rate that was tried"}; the node takes '
            f'{cost:.1f} ns of CPU per point and holds {held[1]:.0f} MB after two scans, {held[-1]:.0f} MB '
            f'after {len(held)}', 2e7,
        )  # fmt: skip
        calm = [graph.scan(2e6, 1.0).latency_ms for _ in range(5)]
        emit(
            'scan.profile_to_map_ms', max(calm), 'ms',
            f'limit; 512 x 512 map, worst of 5, median {np.median(calm):.0f} ms; up to '
            f'{max(latencies, default=0.0):.0f} ms at full rate', 50.0,
        )  # fmt: skip


def print_estimators() -> None:
    print('\n'.join(scan_surface.table()))


FIGURES = {  # memory first, because it looks at the peak of this process
    'scan.memory_mb': bench_memory,
    'scan.rms_mm': bench_accuracy,
    'scan.core_points_per_s': bench_core,
    'scan.ros_points_per_s': bench_ros,
    'scan.profile_to_map_ms': bench_ros,
}
TABLES = {'scan.estimators': print_estimators}
