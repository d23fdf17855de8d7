"""Scan passes: the line scanner beside the torch sees a whole rectangle."""

from __future__ import annotations

import math

import numpy as np

from waam_plan.plan import PlanError, check_reach, hop, numbered
from waam_plan.settings import PlanSettings
from waam_process.segment import Kind, Point, Segment

OVERLAP = 0.2  # of neighbouring scan passes, share of the field of view

Rectangle = tuple[float, float, float, float]


def scan_height(top_z: float, settings: PlanSettings) -> float:
    """Height of torch_tcp (m) while scanning a surface whose highest point is top_z (m).

    The surface lies in the middle of the measuring range, or lower where the torch would come closer to it than
    `clearance`.
    """
    low, high = settings.scanner_range
    return top_z + max(-settings.scanner_offset[2] - (low + high) / 2, settings.clearance)


def scan_lanes(y0: float, y1: float, settings: PlanSettings) -> np.ndarray:
    """Middle of each pass along y (m): evenly spread, overlapping by at least scanner_overlap."""
    fov = settings.scanner_fov
    if y1 - y0 <= fov:
        return np.array([(y0 + y1) / 2])
    step = fov * (1 - OVERLAP)
    count = 1 + int(np.ceil((y1 - y0 - fov) / step - 1e-9))
    return np.linspace(y0 + fov / 2, y1 - fov / 2, count)


def scan_segments(
    spec_region: Rectangle,
    top_z: float,
    settings: PlanSettings,
    start: Point,
    window: bool = False,
    backwards: bool = False,
) -> list[Segment]:
    """SCAN passes along +x and -x over the rectangle (x0, y0, x1, y1; m, work frame) plus margin, from `start`.

    window: the rectangle is a part of what lies there. Then no margin is needed along the passes, where there is no
    run-in, and they begin at the end that is nearer to `start`. backwards: they begin at the other end.

    top_z: highest point that the torch may pass over (m). Segment points are those of torch_tcp; the scanner
    sits scanner_offset beside it. Idle moves lift first, travel at scanning height and connect the passes.
    Raises PlanError when a pass leaves the machine.
    """
    x0, y0, x1, y1 = spec_region
    if not (all(math.isfinite(v) for v in (*spec_region, top_z)) and x0 < x1 and y0 < y1):
        raise PlanError(f'cannot scan the rectangle {spec_region} below z = {top_z} m')
    dx, dy, _ = settings.scanner_offset
    z = scan_height(top_z, settings)
    left, right = x0 - settings.margin - dx, x1 + settings.margin - dx
    out: list[Segment] = []
    here = start
    side = 0.0 if window else settings.margin
    ends = (left, right)
    if window and abs(start[0] - right) < abs(start[0] - left):
        ends = ends[::-1]
    if backwards:
        ends = ends[::-1]
    for lane in scan_lanes(y0 - side, y1 + side, settings):
        a, b = ((float(x), float(lane - dy), z) for x in ends)
        out.extend(hop(here, a, z, settings))
        out.append(
            Segment(0, Kind.SCAN, a, b, settings.scan_speed, speed_programmed=settings.scan_speed)
        )
        here, ends = b, ends[::-1]
    check_reach(out, settings)
    return numbered(out)
