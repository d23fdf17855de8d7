"""Where on a part its error is made: every cell of the plan belongs to one kind of place. Pure; lengths in m."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy import ndimage

from waam_plan import finish, masks
from waam_plan.plan import Plan
from waam_plan.shaft.lines import home_points

from .job import LabMaps

# Kinds of places, a cell belongs to the last one of them that it is.
PLACES = (
    'inside the region',
    'next to standing metal',
    'free sides',
    'arc starts and ends',
    'thin features',
    'overhang',
    'not laid',
)
INSIDE, STANDING, FREE, ENDS, THIN, OVERHANG, NOT_LAID = range(len(PLACES))
LEVEL = 'level of the whole surface'
NEAR = 3e-3  # m: beads end and slump within so much of an edge (half of the usual bead width)


def places(plan: Plan) -> np.ndarray:
    """(rows, cols) int8: number in PLACES of what is laid and what needs metal, -1 elsewhere. plan: of the first
    pass."""
    region, cell = plan.region, plan.spec.resolution
    bead = plan.settings.bead_width
    restored = plan.mode == 'restore'
    needed = finish.needed_area(plan.as_found, plan.nominal) if restored else region
    out = np.where(region, INSIDE, -1).astype(np.int8)
    out[region & (masks.distance_inside(region) * cell <= NEAR)] = STANDING
    free = finish.free_sides(region, plan.nominal.z) if restored else ~region
    out[region & _within(free, NEAR / cell)] = FREE
    out[region & _within(_ends(plan), NEAR / cell)] = ENDS
    out[region & ~masks.drop_slivers(region, masks.ONE_BEAD / 2 * bead / cell)] = THIN
    if not restored and plan.layers:
        out[region & ~_within(plan.layers[0].footprint, bead / 2 / cell)] = OVERHANG
    out[needed & ~region] = NOT_LAID
    return out


def _within(mask: np.ndarray, cells: float) -> np.ndarray:
    """Cells of the mask and within so many cells of it."""
    if not mask.any():
        return mask
    near: np.ndarray = ndimage.distance_transform_edt(~mask) <= cells
    return near


def _ends(plan: Plan) -> np.ndarray:
    """bool: cells in which an arc of the last layer is lit or put out."""
    out, spec = np.zeros(plan.spec.shape, bool), plan.spec
    for path in plan.layers[-1].arc_paths if plan.layers else ():
        for x, y in home_points(path[[0, -1]], plan.settings):
            row = round((y - spec.y[0]) / spec.resolution)
            col = round((x - spec.x[0]) / spec.resolution)
            if 0 <= row < spec.rows and 0 <= col < spec.cols:
                out[row, col] = True
    return out


def shares(maps: Iterable[LabMaps]) -> dict[str, float]:
    """What share of the failure is made where, over several jobs, largest first; {} where nothing is wrong.

    With finish machined of the area below nominal; else of the squared error over the judged area, of which the mean
    error is LEVEL and the rest belongs to the places.
    """
    sums = dict.fromkeys((LEVEL, *PLACES), 0.0)
    for m in maps:
        if m.places is None:
            continue
        if m.below is not None:
            weights, on = m.below.astype(float), m.below
        else:
            on = m.interior & np.isfinite(m.error)
            mean = float(m.error[on].mean()) if on.any() else 0.0
            weights = np.where(on, (m.error - mean) ** 2, 0.0)
            sums[LEVEL] += mean**2 * int(on.sum())
        for number, name in enumerate(PLACES):
            sums[name] += float(weights[on & (m.places == number)].sum())
    total = sum(sums.values())
    found = {name: value / total for name, value in sums.items() if total and value > 0}
    return dict(sorted(found.items(), key=lambda item: -item[1]))
