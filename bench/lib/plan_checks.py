"""What a program must keep to, measured without the planner: geometry by shapely, metal by the simulated cell.

The metal is laid with waam_sim's core (another physics than the planner's footprint), on a field of its own; what the
planner believes about heights is not asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from waam_process.bead import AREA_FACTOR

PORTION = 0.5e-3  # m of path between portions of simulated melt
TIP = 0.6e-3  # m, radius of the wire, whose tip must not touch metal
RANGE = (0.40, 0.76)  # of the bead width: distance of neighbouring beads with the overlap in range
CELL = 0.5e-3


@dataclass(frozen=True)
class Found:
    """Worst of all layers. Shares 0..1, lengths in m."""

    coverage: float  # of the section by beads
    in_range: float  # share of the path whose neighbours are neither too near nor too far
    outside: float  # farthest point of the path outside the section
    idle_depth: float  # deepest that an idle move went into simulated metal
    starts_apart: float  # least distance of arc starts of neighbouring layers


def check(plan, sections) -> Found:
    """All figures of a build; sections: one list of shapely polygons per layer, in work coordinates."""
    covered, spaced, out, apart = [], [], [], []
    starts_before = None
    for layer, polygons in zip(plan.layers, sections, strict=True):
        area = shapely.union_all(polygons)
        path = chains(layer.segments)
        lines = shapely.union_all([shapely.LineString(p) for p in path])
        width = plan.settings.bead_width
        covered.append(lines.buffer(width / 2, quad_segs=16).intersection(area).area / area.area)
        spaced.append(spacing_share(path, area, width))
        out.append(float(lines.difference(area.buffer(1e-9)).length > 0) and farthest(lines, area))
        starts = np.array([p[0] for p in path])
        if starts_before is not None:
            gaps = np.linalg.norm(starts[:, None] - starts_before[None], axis=2)
            apart.append(float(gaps.min()))
        starts_before = starts
    return Found(
        min(covered), min(spaced), max(out), idle_depth(plan), min(apart, default=math.inf)
    )


def chains(segments) -> list[np.ndarray]:
    """Polylines (n, 2) m with the arc on."""
    out, here = [], None
    for s in segments:
        if not (s.arc and s.length > 0):
            here = None
            continue
        if here is None or math.dist(here, s.start) > 1e-9:
            out.append([s.start[:2]])
        out[-1].append(s.end[:2])
        here = s.end
    return [np.array(p) for p in out]


def farthest(lines, area) -> float:
    points = shapely.points(shapely.get_coordinates(lines.difference(area)))
    return float(shapely.distance(area, points).max(initial=0.0))


def spacing_share(path: list[np.ndarray], area, width: float) -> float:
    """Share of the section within half the widest and outside half the narrowest distance of two beads.

    A place is in range when a bead runs within half of RANGE[1] of it (or the edge is nearer than that bead's
    half width), and no two beads run closer than RANGE[0] there: path density times width below 1 / RANGE[0].
    """
    x0, y0, x1, y1 = area.bounds
    x, y = np.meshgrid(np.arange(x0, x1, CELL) + CELL / 2, np.arange(y0, y1, CELL) + CELL / 2)
    on = shapely.contains_xy(area, x.ravel(), y.ravel())
    points = shapely.points(x.ravel()[on], y.ravel()[on])
    lines = shapely.union_all([shapely.LineString(p) for p in path])
    shapely.prepare(lines)
    near = shapely.dwithin(lines, points, RANGE[1] * width / 2 + CELL / 2)
    rim = shapely.dwithin(area.boundary, points, width / 2)
    near |= rim & shapely.dwithin(lines, points, width / 2)
    return float((near & ~crowded(path, x, y, on, width)).mean())


def crowded(path: list[np.ndarray], x, y, on, width: float) -> np.ndarray:
    """Cells of the section where the path is denser than two beads at RANGE[0] lie side by side."""
    from scipy import ndimage

    density = np.zeros(x.shape)
    for p in path:
        step = np.diff(p, axis=0)
        length = np.linalg.norm(step, axis=1)
        n = np.maximum(1, np.ceil(length / (CELL / 2)).astype(int))
        k = np.repeat(np.arange(len(n)), n)
        share = (np.arange(len(k)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[k]
        at = p[k] + share[:, None] * step[k]
        col = ((at[:, 0] - x[0, 0]) / CELL + 0.5).astype(int).clip(0, x.shape[1] - 1)
        row = ((at[:, 1] - y[0, 0]) / CELL + 0.5).astype(int).clip(0, x.shape[0] - 1)
        np.add.at(density, (row, col), (length / n)[k])
    window = int(2 * width / CELL) | 1
    inside = on.reshape(x.shape).astype(float)
    mean = ndimage.uniform_filter(density, window, mode='constant')
    room = ndimage.uniform_filter(inside, window, mode='constant')
    return ((mean / CELL**2 / np.maximum(room, 1e-9)) * width > 1 / RANGE[0]).ravel()[on]


def field(plan, cell: float = CELL, z=None):
    """An empty simulated work-piece around the plan; z: (rows, cols) m to begin with, default the plan's as-found."""
    from waam_process.grid import GridSpec, HeightGrid
    from waam_sim.metal import Metal
    from waam_sim.metal_params import MetalParams

    x0, x1, y0, y1 = plan.spec.extent
    spec = GridSpec.covering(x0, y0, x1, y1, cell)
    if z is None:
        x, y = np.meshgrid(spec.x, spec.y)
        z = plan.as_found.sample(x, y)
        z = np.where(np.isfinite(z), z, np.nanmin(plan.as_found.z))
    return Metal.on(HeightGrid(spec, z), MetalParams(cell=cell))


def lay(metal, segment, clock: float) -> float:
    """One deposit on the field, volume by eq 2.17; returns the time after it."""
    from waam_sim import metal as core

    n = max(1, math.ceil(segment.length / PORTION))
    section = AREA_FACTOR * segment.width * segment.height
    duration = segment.length / segment.speed
    trail = 0.45 * segment.width / max(segment.length, 1e-9)
    for i in range(n):
        t = (i + 0.5) / n - trail
        x, y = (a + t * (b - a) for a, b in zip(segment.start[:2], segment.end[:2], strict=True))
        core.lay(
            z=metal.z, solid=metal.solid, touched=metal.touched, p=metal.params[0], s=metal.state[0], x=x, y=y,
            volume=section * segment.length / n, width=segment.width, height=1.5 * section / segment.width,
            temperature=150.0, time=clock + i / n * duration,
        )  # fmt: skip
    return clock + duration


def idle_depth(plan) -> float:
    """Deepest (m) that the wire tip goes into simulated metal on any idle move of the program; 0 = never.

    Vertical moves end at the bead that the arc lays: there up to two layers of fresh metal are its own.
    """
    metal, clock, worst = field(plan), 0.0, 0.0
    for layer in plan.layers:
        for s in layer.segments:
            if s.arc and s.length > 0:
                clock = lay(metal, s, clock)
            elif s.length > 0:
                worst = max(worst, depth(metal, s, plan.settings.layer_height))
            clock += 1.0
    return worst


def depth(metal, segment, allowed: float) -> float:
    n = max(2, math.ceil(segment.length / 0.5e-3))
    p = np.linspace(segment.start, segment.end, n)
    level = math.dist(segment.start[:2], segment.end[:2]) > 1e-6
    reach = max(1, round(TIP / metal.spec.resolution))
    row, col = metal.spec.cell(p[:, 0], p[:, 1])
    worst = 0.0
    for r, c, z in zip(row, col, p[:, 2], strict=True):
        if not (0 <= r < metal.spec.rows and 0 <= c < metal.spec.cols):
            continue
        top = metal.z[max(0, r - reach) : r + reach + 1, max(0, c - reach) : c + reach + 1].max()
        worst = max(worst, float(top - z) - (0.0 if level else 2.0 * allowed))
    return worst
