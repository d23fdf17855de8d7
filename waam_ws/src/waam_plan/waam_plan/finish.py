"""What of a part needs metal, what of that a plan leaves out, and the machining allowance: how much is laid on top of
the nominal surface so that nothing is below it after machining. Pure; lengths in m, maps (rows, cols).

The lowest places decide. The lowest 0.5 % of the needed area lie some RMS errors below the surface that was aimed at,
and lower still along free sides, where melt runs down; how deep scatters log-normally from job to job.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.stats import norm

from waam_plan import masks
from waam_plan.settings import FINISHES, PlanSettings
from waam_process.grid import GridSpec, HeightGrid

AS_LAID, MACHINED = FINISHES
MIN_MISSING = 0.1e-3  # m, less is the noise and the level of a scan
MIN_HALF_WIDTH = 1.0  # cells of a needed place: a wall that lies a cell aside is no metal
CLEAN_SHARE = 0.995  # of the needed area that must be at or above nominal to clean up
CLEAN_UP_PROBABILITY = 0.95  # with which the chosen allowance cleans up
RUN_OUT_WIDTHS = (
    0.5  # bead widths that metal is laid beyond the needed area, over what stands there
)
MIN_STEP = 1.0e-3  # m between neighbouring cells: run-outs end there, and lower ground beyond one is a free side
MIN_UNLAID = 2e-6  # m2, smaller places are no places
MIN_OVERRUN = 2.2e-3  # m that metal is laid over free sides at least
BEAD_WIDTH_RATIO = 5 / 6  # of the usual bead width: narrower beads leave shallower valleys
RMS_OVER_THICKNESS = (
    0.16  # RMS error over the thickness of the last layer, on the preset `recorded`
)
TAIL_OVER_RMS = 3.0  # depth of the lowest 0.5 % over the RMS error, inside the part
LOG_DEPTH_SIGMA = 0.25  # standard deviation of the logarithm of that depth
SIDE_EXTRA = 0.6e-3  # m more along free sides, where melt runs down; fades out within
SIDE_FADE = 3.0e-3  # m of them
EDGE = 0.5e-3  # m along free sides that stay low now and then, whatever is aimed at
EDGE_LOW = 0.03  # share of them that lies below nominal after top-ups, median over jobs
LOG_EDGE_SIGMA = 0.9  # standard deviation of the logarithm of that share


@dataclass(frozen=True)
class Forecast:
    """How deep (m) the lowest 0.5 % of the needed area will lie below the surface that is aimed at."""

    depth: float  # median over jobs

    def chance(self, allowance: float) -> float:
        """Probability that the part cleans up with so much (m) laid on top of nominal."""
        if allowance <= 0:
            return 0.0
        return float(norm.cdf(math.log(allowance / self.depth) / LOG_DEPTH_SIGMA))

    @property
    def allowance(self) -> float:
        """The smallest one, m in hundredths of a millimetre, that cleans up with CLEAN_UP_PROBABILITY."""
        return (
            math.ceil(self.depth * math.exp(LOG_DEPTH_SIGMA * norm.ppf(CLEAN_UP_PROBABILITY)) * 1e5)
            * 1e-5
        )

    def text(self, allowance: float, given: bool, sides: bool) -> str:
        """For a person. given: by them; sides: whether some of the needed area lies along free sides."""
        said = f'machining allowance {allowance * 1e3:.2f} mm, {"as given" if given else "chosen"}'
        if sides and not given:
            said += f', {SIDE_EXTRA * 1e3:.1f} mm more along free sides'
        said += f': inside the part {CLEAN_SHARE:.1%} clean up with a chance of {self.chance(allowance):.0%}'
        return (
            f'{said} ({self.allowance * 1e3:.2f} mm for {CLEAN_UP_PROBABILITY:.0%})'
            if given
            else said
        )


def forecast(last_layer: float) -> Forecast:
    """last_layer: its thickness, m."""
    return Forecast(TAIL_OVER_RMS * RMS_OVER_THICKNESS * last_layer)


@dataclass(frozen=True)
class Edges:
    """How much of the needed area lies within EDGE of a free side, where melt runs down or draws back."""

    share: float  # of the needed area

    @property
    def chance(self) -> float:
        """Probability that no more of it stays low than a part that cleans up may have."""
        if self.share <= 0:
            return 1.0
        low = (1 - CLEAN_SHARE) / (self.share * EDGE_LOW)
        return float(norm.cdf(math.log(low) / LOG_EDGE_SIGMA))

    @property
    def warning(self) -> str:
        """For a person; '' for a part that is more likely to clean up along its free sides than not."""
        if self.chance >= 0.5:
            return ''
        return (
            f'the part will not clean up along its free sides (chance {self.chance:.0%}): {self.share:.1%} of the '
            f'needed area lie within {EDGE * 1e3:.1f} mm of them, where melt runs down. Clamp run-off plates against '
            'them, allow a chamfer there, or machine the nominal surface deeper'
        )


def edges(needed: np.ndarray, nominal: HeightGrid) -> Edges:
    """Of a part."""
    if not needed.any():
        return Edges(0.0)
    free = free_sides(needed, nominal.z)
    if not free.any():
        return Edges(0.0)
    away = ndimage.distance_transform_edt(~free) - 0.5  # cells between the side and a cell's centre
    near = needed & (away * nominal.spec.resolution <= EDGE)
    return Edges(float(near.sum() / needed.sum()))


def along_sides(needed: np.ndarray, nominal: HeightGrid) -> np.ndarray:
    """m of metal more than the allowance: SIDE_EXTRA at a straight free side of the needed area, half as much again at
    a corner, fading out within SIDE_FADE."""
    free = free_sides(needed, nominal.z)
    near = ndimage.gaussian_filter(
        free * 1.0, SIDE_FADE / 2 / nominal.spec.resolution, mode='nearest'
    )
    return 2.0 * SIDE_EXTRA * near


@dataclass(frozen=True)
class Unlaid:
    """The part of the needed area that gets no metal: too narrow or too shallow for a bead."""

    area: float  # m2
    share: float  # of the needed area
    depth: float  # m, greatest
    x: float  # m, of the greatest depth
    y: float

    @property
    def text(self) -> str:
        """For a person; '' when all is laid."""
        if not self.area:
            return ''
        return (
            f'{self.area * 1e6:.0f} mm2 ({self.share:.1%} of the needed area) get no metal, too narrow or too shallow '
            f'for a bead: up to {self.depth * 1e3:.2f} mm deep at x = {self.x * 1e3:.1f} mm, y = {self.y * 1e3:.1f} mm'
        )


def needed_area(found: HeightGrid, nominal: HeightGrid) -> np.ndarray:
    """bool: where metal is missing, whether or not a bead can lay it. NaN: not seen (as its neighbours), off the part.

    Not steep faces, where a height says nothing, not what is narrower than MIN_HALF_WIDTH, and not what the scan as
    found saw from the side (`seen_from_aside`).
    """
    missing = np.nan_to_num(nominal.z - masks.fill_unknown(found.z), nan=0.0) > MIN_MISSING
    tops = masks.drop_slivers(missing, MIN_HALF_WIDTH) & ~masks.flanks(
        nominal.z, nominal.spec.resolution
    )
    return tops & ~seen_from_aside(tops, found, nominal)


def seen_from_aside(tops: np.ndarray, found: HeightGrid, nominal: HeightGrid) -> np.ndarray:
    """bool: cells of `tops` that an edge of the part cuts, so that the scan as found looked past it: along a free side,
    nothing seen or more than MIN_STEP lower than the next cell inside. No metal on the part changes what such a cell
    shows."""
    rim = tops & ndimage.binary_dilation(free_sides(tops, nominal.z), structure=masks.EIGHT)
    inside = tops & ~rim
    if not inside.any() or not rim.any():
        return np.zeros_like(tops)
    row, col = ndimage.distance_transform_edt(~inside, return_distances=False, return_indices=True)
    beside = masks.fill_unknown(found.z)[row, col]
    return rim & ~(beside - found.z <= MIN_STEP)


def unlaid(needed: np.ndarray, region: np.ndarray, missing: np.ndarray, spec: GridSpec) -> Unlaid:
    """needed, region: bool, what needs and what gets metal; missing: m of metal. Less than MIN_UNLAID is nothing."""
    out = needed & ~region
    if out.sum() * spec.resolution**2 <= MIN_UNLAID:
        return Unlaid(0.0, 0.0, 0.0, math.nan, math.nan)
    depth = np.where(out, np.nan_to_num(missing, nan=0.0), -np.inf)
    row, col = np.unravel_index(int(np.argmax(depth)), depth.shape)
    area = float(out.sum()) * spec.resolution**2
    x, y = float(spec.x[col]), float(spec.y[row])
    return Unlaid(area, float(out.sum() / needed.sum()), float(depth[row, col]), x, y)


def with_run_out(needed: np.ndarray, nominal: np.ndarray, cells: int) -> np.ndarray:
    """bool: the needed area and what lies within so many cells of it on the same face of the part (nominal, m)."""
    out = np.pad(needed, 1)
    face = np.pad(
        nominal, 1, constant_values=np.nan
    )  # nothing is level with what lies beyond the grid
    ways = ((0, 1), (0, -1), (1, 1), (1, -1))
    level = [np.abs(face - np.roll(face, step, axis)) < MIN_STEP for axis, step in ways]
    for _ in range(cells):
        for (axis, step), same_face in zip(ways, level, strict=True):
            out |= np.roll(out, step, axis) & same_face
    return out[1:-1, 1:-1]


def free_sides(on: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """bool: cells off the part (nominal, m, NaN) or lower on it that begin beside `on` with more than MIN_STEP."""
    near = masks.spread(np.where(on, nominal, 0.0), on, np.ones_like(on))
    lower = ~on & ~(near - nominal <= MIN_STEP)
    free: np.ndarray = ndimage.binary_propagation(lower & ndimage.binary_dilation(on), mask=lower)
    return free


def for_machining(settings: PlanSettings, allowance: float) -> PlanSettings:
    """Settings of a restoration that is machined afterwards. allowance: m."""
    return replace(settings, allowance=allowance, overrun=max(settings.overrun, MIN_OVERRUN))


def bead_width(usual: float, finish: str) -> float:
    """m, of a job that does not say it; usual: of the material, m."""
    return usual * BEAD_WIDTH_RATIO if finish == MACHINED else usual
