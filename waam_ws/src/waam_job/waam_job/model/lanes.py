"""The passes of the scanner after a layer: which are needed where the layer was seen beside the arc, and why. Pure.

A pass is a lane along x, as wide as the scanner sees. What was seen finished beside the arc, with enough points, need
not be seen again: a lane is shortened at its ends, or left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from waam_plan.lay.scanning import scan_lanes
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec

from .changed import Window
from .seen import WELL, BesideArc

WELL_SEEN = (
    0.95  # of a column of a lane that was seen beside the arc, for a pass that leaves it out
)
LEAST_CUT = 6  # columns at an end that are worth leaving out


@dataclass(frozen=True)
class Lane:
    """whole: the cells of a pass; needed: those that must be scanned, None = none of them; why: in words."""

    whole: Window
    needed: Window | None
    why: str = ''


def lanes(
    window: Window, spec: GridSpec, settings: PlanSettings, seen: BesideArc | None
) -> list[Lane]:
    """The passes over a window of the grid; seen: what was seen beside the arc, None = nobody looked."""
    parts = list(_parts(window, spec, settings))
    if seen is None:
        return [Lane(part, part) for part in parts]
    return [
        _judged(part, f'pass {k} of {len(parts)}', spec, seen) for k, part in enumerate(parts, 1)
    ]


def _parts(window: Window, spec: GridSpec, settings: PlanSettings) -> Iterator[Window]:
    """The window, divided between its passes in the middle of what two of them see."""
    _, _, y0, y1 = window.spec(spec).extent
    middles = scan_lanes(y0, y1, settings)
    between = np.round(((middles[1:] + middles[:-1]) / 2 - y0) / spec.resolution).astype(int)
    edges = [window.rows[0], *(window.rows[0] + between), window.rows[1]]
    for low, high in zip(edges, edges[1:], strict=False):
        yield Window((int(low), int(high)), window.cols)


def _judged(part: Window, name: str, spec: GridSpec, seen: BesideArc) -> Lane:
    well = np.isfinite(seen.z[part.cells])
    covered, good = float(seen.covered[part.cells].mean()), float(well.mean())
    told = f'{covered:.0%} of it was seen finished beside the arc, {good:.0%} with {WELL} points a cell'
    poor = np.flatnonzero(well.mean(axis=0) < WELL_SEEN)
    if not len(poor):
        return Lane(part, None, f'{name} left out: {told}')
    (a, b), low, high = part.cols, int(poor[0]), int(poor[-1]) + 1
    cols = (a + low if low >= LEAST_CUT else a), (a + high if b - a - high >= LEAST_CUT else b)
    if cols == part.cols:
        return Lane(part, part, f'{name} made: {told}, no whole end')
    needed = Window(part.rows, cols)
    x0, x1, _, _ = needed.spec(spec).extent
    rest = f'x {x0 * 1e3:.0f} to {x1 * 1e3:.0f} mm'
    return Lane(part, needed, f'{name} made over {rest} only: {told}, the ends left out among it')


def scanned(passes: list[Lane]) -> list[Window]:
    """What is scanned, in one go where neighbouring passes are equally long."""
    found: list[Window] = []
    for lane in passes:
        if lane.needed is None:
            continue
        new, last = lane.needed, found[-1] if found else None
        if last is not None and last.cols == new.cols and last.rows[1] == new.rows[0]:
            found[-1] = Window((last.rows[0], new.rows[1]), new.cols)
        else:
            found.append(new)
    return found
