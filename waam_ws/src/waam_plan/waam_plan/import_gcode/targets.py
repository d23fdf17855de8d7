"""The surfaces that the layers of a program are to make: from the path, the nominal part and what lies there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from waam_plan import masks
from waam_plan.settings import MAX_LAYER_RATIO, PlanSettings
from waam_process.grid import GridSpec, HeightGrid

MIN_THICKNESS = 0.3e-3  # m; a thinner remainder is no layer
OFF_GROUND = 3e-3  # m between the lowest layer and what lies there


@dataclass(frozen=True)
class Cover:
    """Cells that the beads of a layer cover, and the height of the path over them, NaN elsewhere. (rows, cols)."""

    footprint: np.ndarray
    ground: np.ndarray


@dataclass(frozen=True)
class Target:
    """Maps of one layer (rows, cols) m, as in PlannedLayer."""

    footprint: np.ndarray
    planned: np.ndarray
    before: np.ndarray
    after: np.ndarray


def cover_of(points: np.ndarray, spec: GridSpec, reach: float) -> Cover:
    """points: (n, 3) m along the path, closer than a cell; reach: m that the metal lies to each side of it."""
    row, col = spec.cell(points[:, 0], points[:, 1])
    on = spec.contains(points[:, 0], points[:, 1])
    z = np.full(spec.shape, np.nan)
    z[row[on], col[on]] = points[on, 2]
    if not on.any():
        return Cover(np.zeros(spec.shape, bool), z)
    away, nearest = ndimage.distance_transform_edt(np.isnan(z), return_indices=True)
    cells = reach / spec.resolution
    footprint = masks.close_gaps(away <= cells, 0.5 * cells)
    ground = z[nearest[0], nearest[1]]
    smooth = masks.blur(ground, footprint, 0.5 * cells)
    return Cover(footprint, np.where(footprint, smooth, np.nan))


def targets_of(
    covers: list[Cover],
    found: np.ndarray,
    nominal: np.ndarray | None,
    settings: PlanSettings,
    last: float,
) -> list[Target]:
    """The surface after a layer is what the next one there is laid on, at last the nominal part.

    found, nominal: (rows, cols) m. Where the nominal part is farther from the top of the last layer than that can be
    thick or thin, and beside the part, the last layer has its own thickness, at the top of all `last` (m).
    """
    thick = [thickness(a, b) for a, b in zip(covers, covers[1:], strict=False)] + [last]
    after = np.full(found.shape, np.nan)
    tops: list[np.ndarray] = []
    for cover, height in zip(covers[::-1], thick[::-1], strict=True):
        own = cover.ground + height
        if nominal is not None:
            most = cover.ground + MAX_LAYER_RATIO * height
            own = np.where(
                (nominal <= most) & (nominal >= cover.ground + MIN_THICKNESS), nominal, own
            )
        after = np.where(cover.footprint & ~np.isfinite(after), own, after)
        tops.append(np.where(cover.footprint, after, np.nan))
        after = np.where(cover.footprint, cover.ground, after)
    return _from_below(covers, tops[::-1], found)


def judged_region(targets: list[Target], nominal: np.ndarray | None) -> np.ndarray:
    """bool (rows, cols): where metal is laid, of a nominal part where the last layer ends at it."""
    top = np.full(targets[0].after.shape, np.nan)
    for t in targets:
        top = np.where(t.footprint, t.after, top)
    laid = np.isfinite(top)
    return laid if nominal is None else laid & (np.abs(top - nominal) < 1e-6)


def thickness(lower: Cover, upper: Cover) -> float:
    """Median distance of two layers where both are, else of all of them, m."""
    both = lower.footprint & upper.footprint
    if both.any():
        return float(np.median((upper.ground - lower.ground)[both]))
    if not (lower.footprint.any() and upper.footprint.any()):
        return MIN_THICKNESS
    return float(np.nanmedian(upper.ground) - np.nanmedian(lower.ground))


def _from_below(covers: list[Cover], tops: list[np.ndarray], found: np.ndarray) -> list[Target]:
    surface = found.copy()  # wanted so far
    laid = np.zeros(found.shape, bool)
    out = []
    for cover, top in zip(covers, tops, strict=True):
        near = np.abs(surface - cover.ground) <= OFF_GROUND
        on = cover.footprint & np.isfinite(top)
        before = np.where(on & (laid | near), surface, np.nan)
        add = top - np.where(np.isfinite(before), before, cover.ground)
        on &= add >= MIN_THICKNESS
        out.append(
            Target(
                on,
                np.where(on, add, 0.0),
                np.where(on, before, np.nan),
                np.where(on, top, np.nan),
            )
        )
        surface = np.where(on, top, surface)
        laid |= on
    return out


def found_surface(found: HeightGrid, settings: PlanSettings, mode: str) -> np.ndarray:
    """(rows, cols) m: the plate of a build at 0, else what was scanned, without its roughness."""
    if mode == 'build':
        return np.zeros(found.spec.shape)
    window = settings.smoothing * settings.bead_width / found.spec.resolution
    return masks.smooth_surface(found.z, window, 0.5 * settings.min_layer * settings.layer_height)
