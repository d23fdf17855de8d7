"""The path of a plan in space, for the preview as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from waam_plan.plan import Plan
from waam_process.segment import Segment

if TYPE_CHECKING:  # matplotlib is loaded only when something is drawn
    from mpl_toolkits.mplot3d.axes3d import Axes3D

MOST_PIECES = 20_000  # drawn; longer programs are thinned out
SURFACE_CELLS = 60  # of the surface below the metal, along its longer side
FLATTEST = 0.3  # height of the picture over its longer side; what is flatter is stretched in z


@dataclass(frozen=True)
class Pieces:
    """Straight pieces with the arc on, (n, 2, 3) mm, their layers (n,), and arc starts, (starts, 3) mm."""

    beads: np.ndarray
    layer: np.ndarray
    starts: np.ndarray


def pieces(plan: Plan) -> Pieces:
    """At most about MOST_PIECES: then neighbours on one path are drawn as one, starts and ends are kept."""
    runs = [run for layer in plan.layers for run in _burning(layer.segments)]
    every = max(1, -(-sum(len(r) for r in runs) // MOST_PIECES))
    kept = [_thinned(run, every) for run in runs]
    ends = [np.stack([line[:-1], line[1:]], 1) for line in kept]
    numbers = [np.full(len(e), run[0].layer) for e, run in zip(ends, runs, strict=True)]
    return Pieces(
        np.concatenate([np.empty((0, 2, 3)), *ends]) * 1e3,
        np.concatenate([np.empty(0, int), *numbers]),
        np.array([line[0] for line in kept]).reshape(-1, 3) * 1e3,
    )


def _burning(segments: list[Segment]) -> list[list[Segment]]:
    """Stretches from arc on to arc off."""
    runs: list[list[Segment]] = []
    before = False
    for s in segments:
        if s.arc and not before:
            runs.append([])
        if s.arc:
            runs[-1].append(s)
        before = s.arc
    return runs


def _thinned(run: list[Segment], every: int) -> np.ndarray:
    """Corners (n, 3), m."""
    points = [run[0].start, *(s.end for s in run)]
    return np.array([*points[:-1:every], points[-1]])


def draw_space(plan: Plan, axis: Axes3D) -> None:
    """Beads coloured from the lowest layer to the highest, arc starts, the surface as found below them."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    found = pieces(plan)
    x, y, z = _surface(plan)
    axis.plot_surface(x, y, z, rstride=1, cstride=1, color='#aab2bd', alpha=0.45, linewidth=0)
    lines = Line3DCollection(found.beads, linewidths=_width(len(plan.layers)), zorder=3)
    lines.set(array=found.layer, cmap='plasma', clim=(1, max(2, len(plan.layers))))
    axis.add_collection3d(lines, autolim=False)
    axis.scatter(*found.starts.T, c='tab:green', s=12, depthshade=False, zorder=4)
    corners = np.concatenate([found.beads.reshape(-1, 3), np.stack([x, y, z], -1).reshape(-1, 3)])
    stretch = _frame(axis, np.nanmin(corners, axis=0), np.nanmax(corners, axis=0))
    layers = f'layers 1 (dark) to {len(plan.layers)} (light), green: arc starts'
    axis.set_title(layers if stretch < 1.05 else f'{layers}; z stretched {stretch:.1f} times')
    axis.view_init(elev=30, azim=-60)


def _width(layers: int) -> float:
    """Thin lines where there are many, points."""
    return float(np.clip(8.0 / max(layers, 1), 0.4, 1.8))


def _surface(plan: Plan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y, z in mm of the surface as found around the metal, thinned; NaN where it is unknown."""
    around = plan.settings.bead_width
    x0, y0, x1, y1 = plan.bounds
    cols = np.flatnonzero((plan.spec.x >= x0 - around) & (plan.spec.x <= x1 + around))
    rows = np.flatnonzero((plan.spec.y >= y0 - around) & (plan.spec.y <= y1 + around))
    step = max(1, -(-max(len(rows), len(cols)) // SURFACE_CELLS))
    x, y = np.meshgrid(plan.spec.x[cols[::step]], plan.spec.y[rows[::step]])
    return x * 1e3, y * 1e3, plan.as_found.z[np.ix_(rows[::step], cols[::step])] * 1e3


def _frame(axis: Axes3D, low: np.ndarray, high: np.ndarray) -> float:
    """Limits (3,), mm, true to scale; flat ones are stretched in z. Returns by how much."""
    size = np.maximum(high - low, 1e-3) * 1.04
    middle = (low + high) / 2
    stretch = max(1.0, FLATTEST * size[:2].max() / size[2])
    limits = np.stack([middle - size / 2, middle + size / 2], 1)
    axis.set(xlim=limits[0], ylim=limits[1], zlim=limits[2])
    axis.set(xlabel='x, mm', ylabel='y, mm', zlabel='z, mm')
    axis.set_box_aspect((size[0], size[1], size[2] * stretch), zoom=1.0)
    return float(stretch)
