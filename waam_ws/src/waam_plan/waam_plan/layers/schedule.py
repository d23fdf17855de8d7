"""How thick the layers of a restoration are: thick ones below, thin ones where the tolerance is decided.

What a layer leaves uncorrected grows with its thickness: the scatter of the metal is not known before it is laid.
So only the finishing layers have to be thin. Three of them take out what the thick ones below have left, because each
one is laid on a scanned surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_plan import masks
from waam_plan.settings import MAX_LAYER_RATIO, PlanSettings

ADAPT = 0.15  # the common thickness may differ from the wanted one by this share
SLIVER = 0.35  # bead widths: narrower arms of a region get no metal
SMALLEST_ISLAND = 0.75  # bead widths squared: smaller patches get no layer of their own
SCATTER = 0.062  # standard deviation of a layer's height over its thickness, on overlapped beads
LAYER_SHARE = 0.61  # of the tolerance that the scatter of the last layer may take; the rest is for bead ends and level
SIGMAS = 1.96  # standard deviations that hold 95 % of the surface
THINNEST = (
    0.4  # finishing layers are no thinner than this share of layer_height, whatever the tolerance
)
ROUGHING = 1.2  # layers below finishing layers, over layer_height


@dataclass(frozen=True)
class Schedule:
    """Thickness of the layers, counted from the final surface down."""

    tops: tuple[float, ...]  # m, of the finishing layers from the top down
    below: float  # m, of every layer under them; the lowest one at each place takes what is left
    thickest: float  # m, that the lowest layer may have

    @property
    def finishing(self) -> int:
        """Number of finishing layers."""
        return len(self.tops)

    def offset(self, k: int) -> float:
        """Depth (m) below the final surface of the upper face of the k-th layer from the top; 0 for k = 1."""
        thin = min(k - 1, self.finishing)
        return sum(self.tops[:thin]) + (k - 1 - thin) * self.below

    def thickness(self, k: int) -> float:
        """Of the k-th layer from the top (m), where it is not the lowest."""
        return self.tops[k - 1] if k <= self.finishing else self.below

    def reason(self, settings: PlanSettings) -> str:
        """What was chosen and why, as a sentence."""
        if not self.finishing:
            return f'layers of {self.below * 1e3:.2f} mm'
        why = (
            f'for a tolerance of {settings.tolerance * 1e3:.2f} mm (the height of a layer scatters by '
            f'{SCATTER:.1%} of its thickness)'
            if not settings.finish_height
            else 'as set'
        )
        return (
            f'{self.finishing} finishing layers of {self.tops[0] * 1e3:.2f} mm {why}, '
            f'layers of {self.below * 1e3:.2f} mm below'
        )


def finishing_layers(settings: PlanSettings) -> tuple[float, ...]:
    """Thickness (m) of the finishing layers from the top down; empty where none are needed or wanted."""
    top = finish_height(settings)
    count = settings.finish_layers if top else 0
    return (top,) * count


def finish_height(settings: PlanSettings) -> float:
    """Thickness (m) of the last layer: as set, or such that their scatter leaves 95 % of the surface within
    LAYER_SHARE of the tolerance. 0: no finishing layers are needed or wanted."""
    if settings.finish_height:
        return settings.finish_height
    if not settings.tolerance or not settings.finish_layers:
        return 0.0
    height = LAYER_SHARE * settings.tolerance / (SIGMAS * SCATTER)
    if height >= settings.layer_height:
        return 0.0
    return max(height, THINNEST * settings.layer_height)


def choose_schedule(depth: np.ndarray, settings: PlanSettings) -> Schedule:
    """The schedule for the depths (m, NaN = off the part).

    The common thickness of the layers below the finishing ones minimises the mean square of
    (lowest layer / thickness - 1), with a slight pull to the wanted one.
    """
    tops = finishing_layers(settings)
    h = settings.layer_height * (ROUGHING if tops else 1.0)
    thickest = MAX_LAYER_RATIO * h
    d = depth[np.isfinite(depth)] - sum(tops)
    d = d[d >= settings.min_layer * h]
    if d.size == 0:
        return Schedule(tops, h, thickest)
    d = d[:: max(1, d.size // 20_000)]
    candidates = h * np.linspace(1 - ADAPT, 1 + ADAPT, 61)
    cost = [
        np.mean(((d - (_equal(d, t, thickest, settings) - 1) * t) / t - 1) ** 2)
        + 0.5 * (t / h - 1) ** 2
        for t in candidates
    ]
    return Schedule(tops, float(candidates[int(np.argmin(cost))]), thickest)


def _equal(
    depth: np.ndarray, thickness: float, thickest: float, settings: PlanSettings
) -> np.ndarray:
    """Number of layers of one thickness (m) for a depth (m), at least 1. The lowest has at least the share min_layer of
    it and is at most `thickest` (m)."""
    spare = max(min(settings.min_layer, thickest / thickness - 1), 0.0)
    return np.maximum(np.ceil(depth / thickness - spare - 1e-9), 1)


def ideal_count(depth: np.ndarray, schedule: Schedule, settings: PlanSettings) -> np.ndarray:
    """Number of layers for a depth (m); 0 where less than the thinnest layer is missing."""
    s = schedule
    if not s.finishing:
        least = settings.min_layer * settings.layer_height
        count = _equal(depth, s.below, s.thickest, settings)
    else:
        least = settings.min_layer * s.tops[0]
        under = depth - sum(s.tops)
        few = np.ones(np.shape(depth))
        for k in range(2, s.finishing + 1):
            few += depth > s.offset(k) + settings.min_layer * s.thickness(k) + 1e-9
        rough = under >= settings.min_layer * s.below
        count = np.where(rough, s.finishing + _equal(under, s.below, s.thickest, settings), few)
    return np.where(depth < least, 0, count).astype(int)


def layer_count(
    depth: np.ndarray, schedule: Schedule, settings: PlanSettings, resolution: float
) -> np.ndarray:
    """Number of layers (rows, cols) from the depth (m, NaN off the part).

    Regions of k layers are closed by a quarter of a bead where half the thinnest layer is still left to lay; slivers
    too narrow and islands too small for a bead are dropped.
    """
    d = np.where(np.isfinite(depth), depth, 0.0)
    ideal = ideal_count(d, schedule, settings)
    bead = settings.bead_width / resolution
    count = np.zeros_like(ideal)
    allowed = np.isfinite(depth)
    for k in range(1, int(ideal.max(initial=0)) + 1):
        thickness = schedule.tops[0] if schedule.finishing else settings.layer_height
        enough = d >= schedule.offset(k) + 0.5 * settings.min_layer * thickness
        level = masks.close_gaps(ideal >= k, bead / 4) & enough & allowed
        level = masks.drop_slivers(level, SLIVER / 2 * bead)
        allowed = masks.drop_small(level, SMALLEST_ISLAND * bead**2)
        count += allowed
    return count
