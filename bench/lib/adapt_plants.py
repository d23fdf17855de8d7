"""Pads of overlapped beads for the adaptation benchmarks: metal that is neither the simulated cell's nor the network's.

Each bead leaves the wire's metal column by column along its travel; across the bead the metal is shared out by a
Gaussian that leans towards the valleys (a Boltzmann weight of the height under it), then surface tension evens out what
is finer than a bead. On top: hump where the arc strikes, crater where it ends, lag of the wire, correlated noise of the
metal, melt that runs further when the layer below is hot. Heights in m.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from waam_adapt.feed.feed_forward import Limits
from waam_process import materials
from waam_process.bead import AREA_FACTOR
from waam_process.grid import GridSpec
from waam_process.segment import Kind

MATERIAL = materials.get('er70s-6')
STEP = 3e-3  # m, length of a segment
MARGIN = 6e-3  # m, plate around the pad
EDGE = 2e-3  # m at the edge of a pad that are not judged: the flank of the outermost beads


@dataclass(frozen=True)
class PadPhysics:
    """What the pad's metal does; the controller believes the material table.

    efficiency: true over table. exponent: of the metal that stays on travel speed (-1: mass balance, none is lost).
    width m: spread of one bead. noise: relative, over `correlation` m along the bead. heat: how fast the pad heats up,
    1 = 400 degC after 20 layers. kt: growth of a hot layer, 1/K above 200 degC. start, end: hump and crater, share.
    wear m: amplitude of the surface under the first layer. missing: share of the map that the scanner does not see.
    """

    efficiency: float = 0.93
    exponent: float = -1.0
    width: float = 5.6e-3
    noise: float = 0.06
    correlation: float = 8e-3
    heat: float = 1.0
    kt: float = 8.5e-4
    start: float = 0.25
    end: float = 0.45
    lag: float = 0.15
    wear: float = 1e-3
    missing: float = 0.0
    scan_sigma: float = 30e-6


@njit(cache=True)
def _lay(z, metal, rows, centre, spread, lean, order):
    """Adds metal (cols,) m2 per column / resolution to z (rows, cols) in travel order; the weights used, (cols, k)."""
    first, k = rows
    weights = np.empty((z.shape[1], k))
    for c in order:
        mean = 0.0
        for i in range(k):
            mean += z[first + i, c]
        mean /= k
        total = 0.0
        for i in range(k):
            w = np.exp(
                -0.5 * ((first + i - centre) / spread) ** 2 - (z[first + i, c] - mean) / lean
            )
            weights[c, i] = w
            total += w
        for i in range(k):
            weights[c, i] /= total
            z[first + i, c] += metal[c] * weights[c, i]
    return weights


@dataclass
class Pad:
    """A pad of beads along x, `length` x `breadth` m, laid in a zig-zag that turns round with every layer."""

    seed: int = 0
    physics: PadPhysics = field(default_factory=PadPhysics)
    length: float = 60e-3
    breadth: float = 40e-3
    height: float = 2e-3
    resolution: float = 0.8e-3
    believed_width: float = 6e-3
    material = MATERIAL
    limits = Limits.of(MATERIAL, (3e-3, 20e-3), (2 / 60, 12 / 60))

    def __post_init__(self) -> None:
        p, m = self.physics, MARGIN
        self.spec = GridSpec.covering(-m, -m, self.length + m, self.breadth + m, self.resolution)
        self.noise_rng = np.random.default_rng(self.seed)
        self.scan_rng = np.random.default_rng(10_000 + self.seed)
        x, y = np.meshgrid(self.spec.x, self.spec.y)
        rough = gaussian_filter(
            np.random.default_rng(20_000 + self.seed).standard_normal(x.shape),
            8e-3 / self.resolution,
        )
        self.z = p.wear * rough / np.abs(rough).max()
        self.inside = (x > 0) & (x < self.length) & (y > 0) & (y < self.breadth)
        edge = EDGE
        self.judged = (x > edge) & (x < self.length - edge) & (y > edge) & (y < self.breadth - edge)
        near = np.minimum(x, self.length - x)
        self.ends = self.judged & (near < 5e-3)
        self.planned = np.where(self.inside, self.height, 0.0)
        self.temperature = 60.0
        n = round(self.breadth / MATERIAL.pitch)
        self.beads = (np.arange(n) + 0.5) * self.breadth / n
        self.weights: list[np.ndarray] = []

    def target(self, laid: int) -> np.ndarray:
        """Wanted surface after `laid` layers."""
        return np.full(self.spec.shape, laid * self.height)

    def path(self, layer: int) -> dict[str, np.ndarray]:
        """Planned segments of a layer from 1, arrays by the names of `feedforward.Path`."""
        edges = np.linspace(0, self.length, round(self.length / STEP) + 1)
        start, end = [], []
        for i, y in enumerate(self.beads):
            x = edges if (i + layer) % 2 == 0 else edges[::-1]
            start += [(a, y, 0.0) for a in x[:-1]]
            end += [(b, y, 0.0) for b in x[1:]]
        n = len(start)
        return {
            'index': np.arange(n), 'kind': np.full(n, int(Kind.DEPOSIT)), 'start': np.array(start),
            'end': np.array(end), 'height': np.full(n, self.height),
            'width': np.full(n, self.breadth / len(self.beads) / AREA_FACTOR),
            'speed': np.full(n, MATERIAL.speed),
        }  # fmt: skip

    def bead_paths(self, layer: int) -> tuple[np.ndarray, ...]:
        """Lines from arc on to arc off in order, with the ends of the segments; (n, 2) m from the corner of the map."""
        p = self.path(layer)
        n = len(p['index']) // len(self.beads)
        corner = np.array([self.spec.origin_x, self.spec.origin_y])
        return tuple(
            np.concatenate([p['start'][i : i + n, :2], p['end'][i + n - 1 : i + n, :2]]) - corner
            for i in range(0, len(p['index']), n)
        )

    def metal(self, start, end, feed, speed, noisy: bool = True) -> list[tuple]:
        """(bead y, columns in travel order, m2 of metal per column) of every bead; noise is used up only when noisy."""
        p, x = self.physics, self.spec.x
        hot = 1 / (1 - p.kt * max(self.temperature - 200.0, 0.0))
        loss = (np.asarray(speed) / MATERIAL.speed) ** (1 + p.exponent)
        section = (
            MATERIAL.wire_area * feed / speed * MATERIAL.efficiency * p.efficiency * hot * loss
        )
        n = len(section) // len(self.beads)
        out = []
        for b, y in enumerate(self.beads):
            part = slice(b * n, (b + 1) * n)
            along = 1.0 if end[part][0, 0] > start[part][0, 0] else -1.0
            middle = 0.5 * (start[part, 0] + end[part, 0])
            shift = along * p.lag * float(np.mean(speed[part]))  # the wire answers late
            order = np.argsort(middle)
            s = np.interp(x, middle[order] + shift, section[part][order])
            s = s * self._ends(x if along > 0 else self.length - x)
            if noisy:
                s = s * (1 + p.noise * self._noise())
            s = gaussian_filter1d(
                np.where((x > 0) & (x < self.length), s, 0.0), 1.2e-3 / self.resolution
            )
            columns = np.arange(x.size)
            out.append((y, columns if along > 0 else columns[::-1].copy(), np.maximum(s, 0.0)))
        return out

    def _ends(self, way: np.ndarray) -> np.ndarray:
        """Factor of the metal `way` m after the arc was struck."""
        p = self.physics
        hump = p.start * np.exp(-np.maximum(way, 0) / 2.5e-3)
        crater = p.end * np.exp(-np.maximum(self.length - way, 0) / 2.5e-3)
        return 1 + hump - crater

    def _noise(self) -> np.ndarray:
        rough = self.noise_rng.standard_normal(self.spec.cols)
        if self.physics.correlation > self.resolution:
            rough = gaussian_filter1d(rough, self.physics.correlation / self.resolution / 2)
        return rough / rough.std()

    def deposit(self, start, end, feed, speed, noisy: bool = True) -> None:
        """Lays one layer, in place; without noise it is what an oracle expects."""
        p = self.physics
        wide = 0.33 * p.width * (1 + 3e-4 * max(self.temperature - 200.0, 0.0))
        self.weights = []
        for y, order, s in self.metal(start, end, feed, speed, noisy):
            centre = (y - self.spec.origin_y) / self.resolution - 0.5
            half = int(np.ceil(2.2 * wide / self.resolution))
            rows = (int(round(centre)) - half, 2 * half + 1)
            weights = _lay(
                self.z, s / self.resolution, rows, centre, wide / self.resolution, 1.5e-3, order
            )
            self.weights.append((rows, weights))
        self._level()
        power = float(np.mean(feed)) / MATERIAL.wire_feed
        rise = 36.0 * p.heat * power
        self.temperature = 40.0 + (self.temperature - 40.0) * 0.93 + rise

    def _level(self) -> None:
        """Surface tension: half of what is finer than 1 mm goes, inside the pad."""
        weight = gaussian_filter(self.inside.astype(float), 1e-3 / self.resolution)
        smooth = gaussian_filter(np.where(self.inside, self.z, 0.0), 1e-3 / self.resolution)
        smooth /= np.maximum(weight, 1e-3)
        self.z += 0.5 * np.where(self.inside, smooth - self.z, 0.0)

    def scan(self) -> np.ndarray:
        """The surface as the scanner sees it: noise, 1 % of holes, and patches of `missing`."""
        z = self.z + self.physics.scan_sigma * self.scan_rng.standard_normal(self.z.shape)
        z[self.scan_rng.random(z.shape) < 0.01] = np.nan
        if self.physics.missing > 0:
            patches = gaussian_filter(
                self.scan_rng.standard_normal(z.shape), 3e-3 / self.resolution
            )
            z[patches < np.quantile(patches, self.physics.missing)] = np.nan
        return z

    def error(self, laid: int) -> np.ndarray:
        """True surface minus wanted, m."""
        return self.z - laid * self.height

    def figures(self, laid: int) -> tuple[float, float, float]:
        """RMS without the last 5 mm at the ends of the beads, of all, and the largest mean error of such an end, m.

        The outermost 2 mm (the slope of the outermost beads) are not judged.
        """
        e = self.error(laid)
        parts = (self.judged & ~self.ends, self.judged)
        return *(float(np.sqrt(np.mean(e[p] ** 2))) for p in parts), self.worst_end(e)

    def worst_end(self, e: np.ndarray) -> float:
        """Largest mean error of the last 5 mm of a bead, over its pitch, m; without the outermost 2 mm."""
        x, y = self.spec.x, self.spec.y
        worst = 0.0
        for bead in self.beads:
            rows = np.abs(y - bead) < 0.5 * self.breadth / len(self.beads)
            rows &= (y > EDGE) & (y < self.breadth - EDGE)
            for way in (x, self.length - x):
                end = (way > EDGE) & (way < 5e-3)
                worst = max(worst, abs(float(e[np.ix_(rows, end)].mean())))
        return worst


def transfer_plants() -> dict[str, PadPhysics]:
    """Pads outside of what the network was trained on."""
    return {
        'exponent -0.6': PadPhysics(exponent=-0.6),
        'white noise': PadPhysics(correlation=0.0),
        'noise over 30 mm': PadPhysics(correlation=30e-3),
        'doubled heat': PadPhysics(heat=2.0),
        '20 % less metal': PadPhysics(efficiency=0.93 * 0.8),
        '30 % of the map missing': PadPhysics(missing=0.3),
    }
