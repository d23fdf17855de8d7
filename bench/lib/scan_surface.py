"""A simulated scan of a known surface, and ways to make one height of the points of a cell (for bench_scan.py)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numba import njit

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion.heights import CellHeights
from waam_scan.fusion.limits import FusionLimits
from waam_scan.transform import Mounting

SPEC = GridSpec(0.0, 0.0, 0.25e-3, 200, 240)  # 60 x 50 mm
NOISE, SPIKES, DROPOUTS, SPIKE_HEIGHT = 30e-6, 0.01, 0.05, 5e-3
EDGE_X = 40e-3  # m, a vertical step of 3 mm
BINS = 64  # of the histogram
HISTOGRAM_LOW, HISTOGRAM_WIDTH = -8e-3, 16e-3  # m


def surface(x, y):
    """m: overlapping beads 5 mm wide, worn hollows with slopes up to 0.5, and a step."""
    beads = 0.5e-3 * np.abs(np.cos(np.pi * y / 5e-3)) ** 1.5
    hollows = 2e-3 * np.sin(x / 8e-3) * np.cos(y / 6e-3)
    return beads + hollows + np.where(x > EDGE_X, 3e-3, 0.0)


@dataclass(frozen=True)
class Scan:
    """tcp: (n, 3) m; x, z: (n, m) float32 m; cell: (n, m) flat cell number, -1 = none; height: (n, m) m, work frame."""

    tcp: np.ndarray
    x: np.ndarray
    z: np.ndarray
    cell: np.ndarray
    height: np.ndarray


def scan(seed: int = 0, pitch: float = 0.05e-3, points: int = 1600) -> Scan:
    """One pass along x with a profile every `pitch` m: noise 0.03 mm, 1 % spikes of up to 5 mm, 5 % drop-outs."""
    rng = np.random.default_rng(seed)
    n = int(62e-3 / pitch)
    tcp = np.zeros((n, 3))
    tcp[:, 0] = np.arange(n) * pitch - 61.013e-3
    tcp[:, 1:] = 25e-3, 15e-3
    x = np.broadcast_to(np.linspace(-26e-3, 26e-3, points), (n, points)).astype(np.float32)
    px, py = tcp[:, :1] + 60e-3 + 0 * x, tcp[:, 1:2] + x
    h = surface(px, py) + rng.normal(0, NOISE, x.shape)
    spike = rng.random(x.shape) < SPIKES
    h[spike] += rng.uniform(-SPIKE_HEIGHT, SPIKE_HEIGHT, spike.sum())
    h[rng.random(x.shape) < DROPOUTS] = np.nan
    row, col = SPEC.cell(px, py)
    inside = SPEC.contains(px, py) & np.isfinite(h)
    cell = np.where(inside, row * SPEC.cols + col, -1)
    return Scan(tcp, x, (h - 0.135).astype(np.float32), cell, h)


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Heights at the cell centres (rows, cols) m, and the mask of the cells away from vertical edges and the border."""
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    good = np.abs(x - EDGE_X) > 0.5e-3
    good &= (x > 1e-3) & (x < 59e-3) & (y > 1e-3) & (y < 49e-3)
    return surface(x, y), good


def ours(s: Scan, sample_only: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
    """Heights, sigma (rows, cols) m and CPU seconds of the adding."""
    fusion = Fusion(SPEC, Mounting(), FusionLimits(-20e-3, 20e-3))
    started = time.process_time()
    fusion.add(s.tcp, s.x, s.z)
    took = time.process_time() - started
    pull = CellHeights._pull
    try:
        # an outlier share that makes the estimate from all points never the better one
        if sample_only:
            CellHeights._pull = lambda self, period: 1.0
        fused = fusion.result()
    finally:
        CellHeights._pull = pull
    return fused.z.astype(float), fused.sigma, took


@njit(cache=True)
def add_mean(cell, height, count, total):
    for i in range(len(cell)):
        c = cell[i]
        if c >= 0:
            count[c] += 1
            total[c] += height[i]


@njit(cache=True)
def add_histogram(cell, height, low, width, bins):
    for i in range(len(cell)):
        c = cell[i]
        if c >= 0:
            k = int((height[i] - low) / width * bins.shape[1])
            if 0 <= k < bins.shape[1]:
                bins[c, k] += 1


def mean(s: Scan) -> tuple[np.ndarray, float]:
    """Plain mean: two sums per cell."""
    cells = SPEC.rows * SPEC.cols
    count, total = np.zeros(cells), np.zeros(cells)
    cell, height = s.cell.ravel(), s.height.ravel()
    add_mean(cell[:1], height[:1], count * 1, total * 1)
    started = time.process_time()
    add_mean(cell, height, count, total)
    took = time.process_time() - started
    return (total / np.maximum(count, 1)).reshape(SPEC.shape), took


def histogram(s: Scan) -> tuple[np.ndarray, float]:
    """Median from 64 counters per cell over 16 mm, interpolated in its bin."""
    bins = np.zeros((SPEC.rows * SPEC.cols, BINS), np.uint16)
    cell, height = s.cell.ravel(), s.height.ravel()
    add_histogram(cell[:1], height[:1], HISTOGRAM_LOW, HISTOGRAM_WIDTH, bins * 1)
    started = time.process_time()
    add_histogram(cell, height, HISTOGRAM_LOW, HISTOGRAM_WIDTH, bins)
    took = time.process_time() - started
    sums = np.cumsum(bins, axis=1, dtype=float)
    half = 0.5 * sums[:, -1:]
    k = (sums < half).sum(axis=1)[:, None]
    below = np.where(k > 0, np.take_along_axis(sums, np.maximum(k - 1, 0), 1), 0.0)
    within = np.maximum(1.0, np.take_along_axis(bins, k, 1))
    z = HISTOGRAM_LOW + (k + (half - below) / within) * HISTOGRAM_WIDTH / BINS
    return z[:, 0].reshape(SPEC.shape), took


def of_all_points(s: Scan, estimate) -> tuple[np.ndarray, float]:
    """estimate((k,) sorted heights) per cell; keeps every point, so the memory grows with the scan."""
    started = time.process_time()
    cell, height = s.cell.ravel(), s.height.ravel()
    order = np.lexsort((height, cell))
    cell, height = cell[order], height[order]
    edges = np.searchsorted(cell, np.arange(SPEC.rows * SPEC.cols + 1))
    z = np.full(SPEC.rows * SPEC.cols, np.nan)
    for c, (a, b) in enumerate(zip(edges, edges[1:], strict=False)):
        if b > a:
            z[c] = estimate(height[a:b])
    return z.reshape(SPEC.shape), time.process_time() - started


def trimmed(h: np.ndarray) -> float:
    """Mean without the 10 % highest and lowest."""
    k = len(h) // 10
    return float(h[k : len(h) - k].mean())


def huber(h: np.ndarray) -> float:
    """Huber's M-estimate (k = 1.345 robust sigmas), ten steps of iterative weights from the median."""
    m = float(np.median(h))
    s = 1.4826 * float(np.median(np.abs(h - m))) + 1e-9
    for _ in range(10):
        w = np.minimum(1.0, 1.345 * s / np.maximum(np.abs(h - m), 1e-12))
        m = float((w * h).sum() / w.sum())
    return m


def errors(z: np.ndarray) -> tuple[float, float]:
    """RMS and bias (m) against the truth, away from edges."""
    true, good = truth()
    e = (z - true)[good & np.isfinite(z)]
    return float(np.sqrt(np.mean(e**2))), float(e.mean())


def table() -> list[str]:
    """Rows of Markdown: estimator, rms, bias, worst cell, cost, memory."""
    s = scan()
    ours(s)  # compiled
    true, good = truth()
    rows = [
        ('plain mean', *mean(s), 'constant'),
        ('median (exact)', *of_all_points(s, lambda h: float(np.median(h))), 'all points'),
        ('trimmed mean, 10 % each side', *of_all_points(s, trimmed), 'all points'),
        ("Huber's M-estimate", *of_all_points(s, huber), 'all points'),
        ('histogram, 64 bins over 16 mm, median', *histogram(s), 'constant'),
        ('sample of 16 points, clipped mean', *ours(s, True)[::2], 'constant'),
        ('sine M-estimate with sample (ours)', *ours(s)[::2], 'constant'),
    ]
    lines = [
        '| estimator | rms mm | bias mm | worst cell mm | ns per point | memory |',
        '|---|---|---|---|---|---|',
    ]
    for name, z, took, memory in rows:
        rms, bias = errors(z)
        worst = float(np.nanmax(np.abs(z - true)[good]))
        lines.append(
            f'| {name} | {rms * 1e3:.4f} | {bias * 1e3:+.4f} | {worst * 1e3:.3f} '
            f'| {took / s.x.size * 1e9:.1f} | {memory} |'
        )
    return lines
