"""Random parts for the training: footprint and beads of pads, walls, rings and blades; surfaces as
found; holes of scans.

Lengths in cells (a quarter of a bead that the controller believes in), heights in planned layer heights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from waam_process.bead import AREA_FACTOR

from ..grids import CELLS_PER_BEAD

SIZE = 36  # cells of a training map, 9 beads
BEAD = CELLS_PER_BEAD
RANGES = {  # what the model card states; lengths in bead widths, heights in layer heights
    'layer_height_mm': (1.0, 3.0), 'efficiency': (0.75, 1.2), 'exponent_pad': (0.75, 1.15),
    'exponent_wall': (0.6, 1.0), 'noise': (0.01, 0.09), 'noise_length': (0.3, 3.0),
    'bead_noise': (0.0, 0.04), 'hump': (0.0, 0.7), 'crater': (0.0, 0.8), 'defect_length': (0.25, 0.8),
    'filling': (0.4, 2.5), 'levelling': (0.08, 0.22), 'wear': (0.0, 0.6), 'scan_sigma': (0.002, 0.06),
    'holes': (0.0, 0.4), 'true_width': (0.8, 1.35), 'heat': (-0.02, 0.03), 'gain': (0.7, 1.0),
    'planned_variation': (0.0, 0.3), 'pool_length': (0.12, 0.4), 'spikes': (0.0, 0.01), 'lag': (0.0, 1.0),
    'cliff': (0.3, 5.0), 'conserved': (0.0, 1.0), 'spill': (0.05, 1.0), 'run_over': (0.0, 1.0),
}  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One part: footprint, and for even and odd layers beads as arrays (n, 2) of row, col one cell
    apart; pitch in cells.
    """

    footprint: np.ndarray
    beads: tuple[list[np.ndarray], list[np.ndarray]]
    direction: tuple[tuple[float, float], tuple[float, float]]
    pitch: float
    wall: bool


def draw(rng: np.random.Generator, name: str) -> float:
    """A value of RANGES[name], evenly distributed."""
    return float(rng.uniform(*RANGES[name]))


def part(rng: np.random.Generator) -> Part:
    """Pads most often, for they are the hardest."""
    kind = rng.choice(['pad', 'wall', 'ring', 'blade'], p=[0.62, 0.16, 0.1, 0.12])
    if kind in ('ring', 'blade'):
        return _ring(rng, kind == 'blade')
    return _pad(rng, 1 if kind == 'wall' else int(rng.integers(3, 11)))


def _order(
    rng: np.random.Generator, beads: list[np.ndarray], zigzag: bool, joined: bool
) -> list[np.ndarray]:
    """Directions of the beads; joined: one bead from first to last, as an arc that is not interrupted."""
    if zigzag:
        beads = [b if i % 2 == 0 else b[::-1] for i, b in enumerate(beads)]
    return [np.concatenate(beads)] if joined else beads


def _pad(rng: np.random.Generator, n: int) -> Part:
    angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)], p=[0.4, 0.3, 0.3])
    pitch = BEAD * AREA_FACTOR * rng.uniform(0.92, 1.06)
    straight = abs(np.sin(2 * angle)) < 1e-6
    room = SIZE - 6 if straight else SIZE * 0.64
    length, breadth = rng.uniform(16, room), n * pitch
    n = max(1, min(n, int(room / pitch)))
    breadth = n * pitch
    centre = np.array([SIZE / 2, SIZE / 2]) - 0.5 + rng.uniform(-1, 1, 2)
    inset = rng.choice([0.0, rng.uniform(0, 0.5) * BEAD])
    zigzag, joined = rng.random() < 0.7, rng.random() < 0.35
    mode = rng.choice(['none', 'reverse', 'cross'], p=[0.3, 0.5, 0.2])
    along, across = (
        np.array([np.sin(angle), np.cos(angle)]),
        np.array([np.cos(angle), -np.sin(angle)]),
    )
    first = _order(
        rng,
        _hatch(centre, along, across, length - 2 * inset, breadth, n),
        zigzag,
        joined and zigzag,
    )
    direction = (along[1], along[0]), (along[1], along[0])
    if mode == 'cross' and n > 2:
        m = max(1, round(length / pitch))
        other = _hatch(centre, across, along, breadth - 2 * inset, length, m)
        second = _order(rng, other, zigzag, joined and zigzag)
        direction = direction[0], (across[1], across[0])
    else:
        second = [b[::-1] for b in reversed(first)] if mode == 'reverse' else first
    rows, cols = np.mgrid[:SIZE, :SIZE]
    d = np.stack([rows - centre[0], cols - centre[1]], -1)
    footprint = (np.abs(d @ along) <= length / 2) & (np.abs(d @ across) <= max(breadth / 2, 1.3))
    return Part(footprint, (first, second), direction, breadth / n, n == 1)


def _hatch(
    centre: np.ndarray, along: np.ndarray, across: np.ndarray, length: float, breadth: float, n: int
) -> list[np.ndarray]:
    s = np.linspace(-length / 2, length / 2, max(3, round(length) + 1))
    offsets = ((np.arange(n) + 0.5) / n - 0.5) * breadth
    return [centre + s[:, None] * along + t * across for t in offsets]


def _ring(rng: np.random.Generator, blade: bool) -> Part:
    """Concentric circles, or with `blade` an arc of a few of them."""
    n = int(rng.integers(1, 4))
    pitch = BEAD * AREA_FACTOR
    radius = (
        rng.uniform(22, 60)
        if blade
        else rng.uniform(n * pitch / 2 + 3, SIZE / 2 - 3 - n * pitch / 2)
    )
    half = rng.uniform(12, SIZE / 2 - 3) / radius if blade else np.pi
    middle = rng.uniform(-np.pi, np.pi)
    centre = np.array([SIZE / 2, SIZE / 2]) - 0.5
    if blade:
        centre = centre - radius * np.array([np.sin(middle), np.cos(middle)])
    beads = []
    for i in range(n):
        r = radius + (i + 0.5 - n / 2) * pitch
        a = middle + np.linspace(-half, half, max(6, round(2 * half * r)))
        beads.append(centre + r * np.stack([np.sin(a), np.cos(a)], -1))
    first = _order(rng, beads, blade, False)
    second = [b[::-1] for b in reversed(first)] if rng.random() < 0.5 else first
    rows, cols = np.mgrid[:SIZE, :SIZE]
    d = np.stack([rows - centre[0], cols - centre[1]], -1)
    r = np.hypot(d[..., 0], d[..., 1])
    turn = np.abs((np.arctan2(d[..., 0], d[..., 1]) - middle + np.pi) % (2 * np.pi) - np.pi)
    footprint = (np.abs(r - radius) <= max(n * pitch / 2, 1.3)) & (turn <= half)
    along = (-np.sin(middle), np.cos(middle)) if blade else (0.0, 0.0)
    return Part(footprint, (first, second), (along, along), pitch, n == 1)


def worn(rng: np.random.Generator) -> np.ndarray:
    """The surface as found: tilt, waves of several lengths, pits; zero mean."""
    z = np.zeros((SIZE, SIZE))
    for length in (3.0, 8.0, 16.0):
        wave = gaussian_filter(rng.standard_normal(z.shape), length, mode='reflect')
        z += rng.uniform(0, 1) * wave / wave.std()
    if rng.random() < 0.3:
        r, c = np.mgrid[:SIZE, :SIZE] - rng.uniform(8, SIZE - 8, (2, 1, 1))
        z -= 3 * rng.uniform(0.5, 1.5) * (np.hypot(r, c) < rng.uniform(3, 8))
        z = gaussian_filter(z, 1.0)
    return draw(rng, 'wear') * (z - z.mean()) / max(z.std(), 1e-6) * 0.6


def holes(rng: np.random.Generator) -> np.ndarray:
    """Cells that a scan does not see: single ones and, now and then, whole patches."""
    out = rng.random((SIZE, SIZE)) < rng.choice([0.0, 0.01])
    share = draw(rng, 'holes') if rng.random() < 0.25 else 0.0
    if share:
        field = gaussian_filter(rng.standard_normal((SIZE, SIZE)), rng.uniform(1, 5))
        out |= field > np.quantile(field, 1 - share)
    return out
