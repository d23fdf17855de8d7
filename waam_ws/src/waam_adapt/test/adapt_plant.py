"""A small plant for the tests of the loop: overlapped beads on a height field.

Nothing of the controller's model is in it but the mass balance; efficiency, bead width and noise are its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from waam_process import materials
from waam_process.grid import GridSpec
from waam_process.segment import Kind

MATERIAL = materials.get('er70s-6')
STEP = 3e-3  # m, length of a segment


@dataclass
class Plant:
    """A pad of beads along x, `length` x `breadth` m, on a plate with a margin. Heights in m."""

    seed: int = 0
    efficiency: float = 0.85  # true over table
    width: float = 5.5e-3  # true bead width; the controller believes 6 mm
    noise: float = 0.04  # relative, of the metal along a bead, correlated over 8 mm
    levelling: float = 0.5  # share of the unevenness finer than 1 mm that the melt flattens
    scan_sigma: float = 20e-6
    length: float = 60e-3
    breadth: float = 40e-3
    shift: bool = False  # every second layer between the beads of the one below
    resolution: float = 0.5e-3
    z: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        margin = 6e-3
        self.rng = np.random.default_rng(self.seed)
        self.spec = GridSpec.covering(
            -margin, -margin, self.length + margin, self.breadth + margin, self.resolution
        )
        x, y = np.meshgrid(self.spec.x, self.spec.y)
        wear = 0.3e-3 * np.sin(x / 15e-3) * np.cos(y / 11e-3)  # the substrate is not flat
        self.z = wear + 0.15e-3 * gaussian_filter(self.rng.standard_normal(x.shape), 12) * 20
        self.inside = (x > 0) & (x < self.length) & (y > 0) & (y < self.breadth)
        m = 3e-3
        self.interior = (x > m) & (x < self.length - m) & (y > m) & (y < self.breadth - m)

    def beads(self, layer: int) -> np.ndarray:
        """y of the bead centres of a layer."""
        n = round(self.breadth / MATERIAL.pitch)
        pitch = self.breadth / n
        shift = (0.25 if layer % 2 else -0.25) * pitch if self.shift else 0.0
        return (np.arange(n) + 0.5) * pitch + shift

    def path(self, layer: int, height: float) -> dict[str, np.ndarray]:
        """Arrays of the planned segments (names of feedforward.Path), bead by bead, alternating direction."""
        edges = np.linspace(0, self.length, round(self.length / STEP) + 1)
        start, end = [], []
        for i, y in enumerate(self.beads(layer)):
            x = edges if i % 2 == 0 else edges[::-1]
            start += [(a, y, 0.0) for a in x[:-1]]
            end += [(b, y, 0.0) for b in x[1:]]
        n = len(start)
        return {
            'index': np.arange(n), 'kind': np.full(n, int(Kind.DEPOSIT)), 'start': np.array(start),
            'end': np.array(end), 'height': np.full(n, height),
            'width': np.full(n, self.breadth / len(self.beads(1)) / 0.73),
            'speed': np.full(n, MATERIAL.speed),
        }  # fmt: skip

    def deposit(
        self, start: np.ndarray, end: np.ndarray, feed: np.ndarray, speed: np.ndarray
    ) -> None:
        """Lays one layer: each bead fills what lies below its crown, then the melt levels a little."""
        x, y = self.spec.x, self.spec.y
        section = MATERIAL.wire_area * feed * MATERIAL.efficiency * self.efficiency / speed
        for y_bead in dict.fromkeys(start[:, 1]):
            mine = start[:, 1] == y_bead
            middle = 0.5 * (start[mine, 0] + end[mine, 0])
            order = np.argsort(middle)
            metal = np.interp(x, middle[order], section[mine][order])
            metal = np.where((x > 0) & (x < self.length), metal, 0.0)
            rough = gaussian_filter1d(self.rng.standard_normal(x.size), 8e-3 / self.resolution)
            metal *= 1 + self.noise * rough / rough.std()
            metal = gaussian_filter1d(metal, 1.5e-3 / self.resolution)
            rows = np.abs(y - y_bead) < 0.5 * self.width
            crown = 0.6e-3 * (1 - (2 * (y[rows] - y_bead) / self.width) ** 2)
            self.z[rows] = self._merge(self.z[rows], crown, metal / self.resolution)
        weight = gaussian_filter(self.inside.astype(float), 1e-3 / self.resolution)
        smooth = gaussian_filter(
            np.where(self.inside, self.z, 0.0), 1e-3 / self.resolution
        ) / np.maximum(weight, 1e-3)
        self.z += self.levelling * np.where(self.inside, smooth - self.z, 0)

    @staticmethod
    def _merge(z: np.ndarray, crown: np.ndarray, metal: np.ndarray) -> np.ndarray:
        """Surface (rows, cols) under a bead: `crown` (rows,) above a level that conserves the metal."""
        z = np.maximum(z, np.median(z, axis=0) - 1.5e-3)  # hangs over a cliff instead of filling it
        low = z.min(axis=0) - crown.max()
        high = z.max(axis=0) + metal / len(crown)
        for _ in range(30):
            level = 0.5 * (low + high)
            laid = np.maximum(level + crown[:, None] - z, 0).sum(axis=0)
            low, high = np.where(laid < metal, level, low), np.where(laid < metal, high, level)
        return np.maximum(z, level + crown[:, None])

    def scan(self) -> np.ndarray:
        """The surface as the scanner sees it, with noise and 1 % of holes."""
        z = self.z + self.scan_sigma * self.rng.standard_normal(self.z.shape)
        z[self.rng.random(z.shape) < 0.01] = np.nan
        return z
