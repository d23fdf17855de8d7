"""What is compared: grown metal, layer by layer, in two bands of size, where a scanner can be believed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import (
    binary_dilation,
    correlate1d,
    gaussian_filter,
    maximum_filter,
    minimum_filter,
    uniform_filter,
)

from .replay import Laid, Replay

STEEP = 1.2e-3  # m of height within three cells, beyond which a scanner averages over an edge
WIDE = 4.5e-3  # m, sigma that parts what scatters with the metal from what has the shape of beads
BLOCK = 2  # cells; heights are averaged over so many
LAYER_LEVEL, JOB_LEVEL = 0.008, 0.004  # share of the metal that a layer, a job is laid anew wrongly
PATCH, PATCH_SIZE = 3e-5, 3e-3  # m, height and size of what is wrong within a layer
NARROW = 0.015  # share of the height of narrow structure: ridges that are laid anew a little beside lose some
CELL_MEAN = (
    1 / 24,
    22 / 24,
    1 / 24,
)  # mean over a cell, from the middles of three (to the second order)


class Comparison:
    """The cells of a recorded job that count, and the misfit of a simulated one on them."""

    def __init__(self, replay: Replay) -> None:
        self.resolution = replay.record.spec.resolution
        self.masks: dict[int, np.ndarray] = {}
        self.measured: dict[int, np.ndarray] = {}
        for number, ground in replay.ground.items():
            grown = ground.after - ground.before
            use = np.isfinite(grown) & binary_dilation(ground.planned > 0, iterations=6)
            for z in (ground.before, ground.after):
                use &= ~_steep(z)
            if use.sum() >= 100:
                self.masks[number], self.measured[number] = use, np.where(use, grown, 0.0)

    @property
    def area(self) -> float:
        """m^2 that count, over all layers."""
        return sum(int(m.sum()) for m in self.masks.values()) * self.resolution**2

    def off(self, laid: Laid) -> dict[int, np.ndarray]:
        """Measured less laid, layer -> (rows, cols) m; 0 where nothing counts."""
        return {
            k: np.where(use, self.measured[k] - seen(laid.growth[k]), 0.0)
            for k, use in self.masks.items()
        }

    def difference(self, a: Laid, b: Laid) -> dict[int, np.ndarray]:
        """Laid `a` less laid `b`, in the form of `off`."""
        return {k: np.where(m, seen(a.growth[k] - b.growth[k]), 0.0) for k, m in self.masks.items()}

    def bands(self, maps: Mapping[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Maps as of `off`, wide and narrow structure apart, blocks of cells as (n,) each, m."""
        wide, narrow = [], []
        for k in self.masks:
            low = self._low(k, maps[k])
            wide.append(_blocks(low))
            narrow.append(_blocks(maps[k] - low))
        return np.concatenate(wide), np.concatenate(narrow)

    def _low(self, layer: int, values: np.ndarray) -> np.ndarray:
        """Wide structure of a map that is 0 where nothing counts."""
        use, sigma = self.masks[layer], WIDE / self.resolution
        weight = gaussian_filter(use.astype(float), sigma)
        return np.where(use, gaussian_filter(values, sigma) / np.maximum(weight, 1e-3), 0.0)

    def misfit(self, laid: Laid) -> float:
        """RMS of what was measured less what was laid, m."""
        off = self.off(laid)
        values = np.concatenate([off[k][m] for k, m in self.masks.items()])
        return float(np.sqrt(np.mean(values**2)))

    def volume(self, laid: Laid) -> float:
        """Metal laid over metal measured."""
        measured = sum(float(m.sum()) for m in self.measured.values())
        return sum(float(laid.growth[k][m].sum()) for k, m in self.masks.items()) / measured

    def wrong(self, laid: Laid, rng: np.random.Generator) -> dict[int, np.ndarray]:
        """What laying a record anew is wrong by: a draw, in the form of `off`."""
        job = JOB_LEVEL * rng.standard_normal()
        height = NARROW * rng.standard_normal()
        sigma = PATCH_SIZE / self.resolution
        found = {}
        for k, use in self.masks.items():
            patches = (
                gaussian_filter(rng.standard_normal(use.shape), sigma) * 2 * np.sqrt(np.pi) * sigma
            )
            level = job + LAYER_LEVEL * rng.standard_normal()
            grown = np.where(use, seen(laid.growth[k]), 0.0)
            ridges = grown - self._low(k, grown)
            found[k] = np.where(use, level * grown + PATCH * patches + height * ridges, 0.0)
        return found


def seen(grown: np.ndarray) -> np.ndarray:
    """What a map shows of metal (rows, cols) m laid on the middles of its cells: a scan has means over them."""
    rows = correlate1d(grown, CELL_MEAN, axis=0, mode='nearest')
    return correlate1d(rows, CELL_MEAN, axis=1, mode='nearest')


def _steep(z: np.ndarray) -> np.ndarray:
    """Cells near a step or near what was not seen."""
    known = np.isfinite(z)
    high = maximum_filter(np.where(known, z, -np.inf), 3)
    low = minimum_filter(np.where(known, z, np.inf), 3)
    return binary_dilation((high - low > STEEP) | ~known, iterations=3)


def _blocks(values: np.ndarray) -> np.ndarray:
    return uniform_filter(values, BLOCK)[::BLOCK, ::BLOCK].ravel()
