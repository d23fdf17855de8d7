"""A simulated scan of a known surface for bench_scan.py, its map, and what is simpler than the estimator."""

from __future__ import annotations

import numpy as np

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion.limits import FusionLimits
from waam_scan.transform import Mounting

SPEC = GridSpec(0.0, 0.0, 0.25e-3, 200, 240)  # 60 x 50 mm
NOISE, SPIKES, DROPOUTS, SPIKE_HEIGHT = 30e-6, 0.01, 0.05, 5e-3
EDGE_X = 40e-3  # m, a vertical step of 3 mm


def surface(x, y):
    """m: overlapping beads 5 mm wide, worn hollows with slopes up to 0.5, and a step."""
    beads = 0.5e-3 * np.abs(np.cos(np.pi * y / 5e-3)) ** 1.5
    hollows = 2e-3 * np.sin(x / 8e-3) * np.cos(y / 6e-3)
    return beads + hollows + np.where(x > EDGE_X, 3e-3, 0.0)


def scan() -> tuple[np.ndarray, ...]:
    """One pass along x with a profile every 0.05 mm: noise 0.03 mm, 1 % spikes of up to 5 mm, 5 % drop-outs. Tip
    (n, 3), x and z of the profiles (n, m) float32, flat number of the cell (-1 = none) and height of the points, m."""
    rng, pitch, points = np.random.default_rng(0), 0.05e-3, 1600
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
    return tcp, x, (h - 0.135).astype(np.float32), cell.ravel(), h.ravel()


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Heights at the cell centres (rows, cols) m, and the mask of the cells away from vertical edges and the border."""
    x, y = np.meshgrid(SPEC.x, SPEC.y)
    good = np.abs(x - EDGE_X) > 0.5e-3
    good &= (x > 1e-3) & (x < 59e-3) & (y > 1e-3) & (y < 49e-3)
    return surface(x, y), good


def ours(tcp: np.ndarray, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights and sigma (rows, cols) m."""
    fusion = Fusion(SPEC, Mounting(), FusionLimits(-20e-3, 20e-3))
    fusion.add(tcp, x, z)
    fused = fusion.result()
    return fused.z.astype(float), fused.sigma


def per_cell(cell: np.ndarray, height: np.ndarray, estimate) -> np.ndarray:
    """estimate(heights) of every cell, m."""
    order = np.argsort(cell, kind='stable')
    edges = np.searchsorted(cell[order], np.arange(SPEC.rows * SPEC.cols + 1))
    groups = (height[order[a:b]] for a, b in zip(edges, edges[1:], strict=False))
    return np.array([estimate(h) if len(h) else np.nan for h in groups]).reshape(SPEC.shape)


def errors(z: np.ndarray) -> tuple[float, float]:
    """RMS and bias (m) against the truth, away from edges."""
    true, good = truth()
    e = (z - true)[good & np.isfinite(z)]
    return float(np.sqrt(np.mean(e**2))), float(e.mean())
