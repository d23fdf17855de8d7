"""A picture of a plan and a table of its layers, to look at before the arc goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from waam_plan.plan import Plan, PlannedLayer, metal_of
from waam_plan.settings import MAX_LAYER_RATIO
from waam_plan.shaft.lines import drawn

if TYPE_CHECKING:  # matplotlib is loaded only when something is drawn
    from matplotlib.axes import Axes

SHOWN = 6  # layers drawn at most
APART = 1e-4  # m between two segments that are not drawn as one line: the seam of a shaft


@dataclass(frozen=True)
class LayerEstimate:
    """Estimate of one layer. SI."""

    number: int
    beads: int
    arc_starts: int
    length: float  # m of bead
    arc_time: float  # s, with the time that the arc burns before the torch moves
    duration: float  # s without acceleration
    wire: float  # m
    mass_share: float  # metal of the segments over metal of the map and of the sides
    heat: float  # J of the arc, before its efficiency; from the set power
    height_mean: float  # m
    height_min: float
    height_max: float
    gas: float = 0.0  # m3
    heat_input: float = 0.0  # J/m of bead that reach the part: I U eta_th / V, eq 2.18


def estimates(plan: Plan) -> list[LayerEstimate]:
    """One line per layer."""
    return [_estimate(plan, layer) for layer in plan.layers]


def _estimate(plan: Plan, layer: PlannedLayer) -> LayerEstimate:
    s = plan.settings
    burning = sum(segment.duration for segment in layer.segments if segment.arc)
    height = np.array([d.height for d in layer.deposits])
    want = metal_of(layer, plan.spec, s)
    return LayerEstimate(
        number=layer.number,
        beads=layer.beads,
        arc_starts=layer.arc_starts,
        length=layer.length,
        arc_time=burning,
        duration=layer.duration,
        wire=layer.volume / (s.wire_area * s.efficiency),
        mass_share=layer.volume / want if want > 0 else 1.0,
        heat=s.arc_power * burning,
        height_mean=float(height.mean()),
        height_min=float(height.min()),
        height_max=float(height.max()),
        gas=s.gas_flow * burning,
        heat_input=s.arc_efficiency * s.arc_power * burning / max(layer.length, 1e-9),
    )


def table(plan: Plan) -> str:
    """The layers as text, one line each, and the totals."""
    head = 'layer  beads  arcs  bead m  arc s  total s  wire m  heat kJ   height mm (min mean max)  metal'
    lines = [head]
    found = estimates(plan)
    for e in found:
        lines.append(
            f'{e.number:5d} {e.beads:6d} {e.arc_starts:5d} {e.length:7.2f} {e.arc_time:6.0f} {e.duration:8.0f} '
            f'{e.wire:7.2f} {e.heat / 1e3:8.0f}   {e.height_min * 1e3:6.2f} {e.height_mean * 1e3:6.2f} '
            f'{e.height_max * 1e3:6.2f}        {e.mass_share:6.1%}'
        )
    if found:
        burning, heat = sum(e.arc_time for e in found), sum(e.heat for e in found)
        lines.append(
            f'total {plan.beads:6d} {plan.arc_starts:5d} {plan.length:7.2f} {burning:6.0f} '
            f'{plan.duration:8.0f} {plan.wire:7.2f} {heat / 1e3:8.0f}'
        )
    return '\n'.join(lines)


def draw(plan: Plan, path: Path | str) -> None:
    """Writes a PNG: as-found depth, a section through the middle, path and planned metal of up to six layers."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = _shown(plan)
    cols = 2 if len(shown) <= 2 else 3 if len(shown) <= 4 else 4
    rows = -(-(2 + len(shown)) // cols)
    figure = Figure(figsize=(4.2 * cols, 3.8 * rows), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(
        f'{plan.name} ({plan.mode}): {len(plan.layers)} layers, {plan.beads} beads, {plan.arc_starts} arc starts, '
        f'{plan.wire:.1f} m wire, {plan.duration / 60:.1f} min'
    )
    axes = [figure.add_subplot(rows, cols, i + 1) for i in range(2 + len(shown))]
    _draw_depth(plan, axes[0])
    _draw_section(plan, axes[1])
    for axis, layer in zip(axes[2:], shown, strict=True):
        _draw_layer(plan, layer, axis)
    figure.savefig(path, dpi=110)


def _shown(plan: Plan) -> list[PlannedLayer]:
    pick = np.unique(np.linspace(0, len(plan.layers) - 1, min(SHOWN, len(plan.layers))).round())
    return [plan.layers[int(i)] for i in pick] if plan.layers else []


def _map(plan: Plan, axis: Axes, z: np.ndarray, title: str, label: str, **options: Any) -> None:
    x0, x1, y0, y1 = (v * 1e3 for v in plan.spec.extent)
    shown = axis.imshow(
        z, origin='lower', extent=(x0, x1, y0, y1), interpolation='nearest', **options
    )
    axis.figure.colorbar(shown, ax=axis, label=label, shrink=0.8)
    axis.set(title=title, xlabel='x, mm', ylabel='y, mm')
    a, b, c, d = (v * 1e3 for v in plan.bounds)
    pad = 0.05 * max(c - a, d - b) + plan.settings.bead_width * 1e3
    axis.set(xlim=(max(x0, a - pad), min(x1, c + pad)), ylim=(max(y0, b - pad), min(y1, d + pad)))


def _draw_depth(plan: Plan, axis: Axes) -> None:
    depth = (plan.final_target if plan.layers else plan.nominal.z) - plan.as_found.z
    _map(plan, axis, depth * 1e3, 'metal to add', 'mm', cmap='viridis')


def _draw_section(plan: Plan, axis: Axes) -> None:
    """Heights along x through the middle of the region."""
    _, y0, _, y1 = plan.bounds
    row = int(np.clip(plan.spec.cell(0.0, (y0 + y1) / 2)[0], 0, plan.spec.rows - 1))
    x = plan.spec.x * 1e3
    axis.plot(x, plan.as_found.z[row] * 1e3, 'k', lw=1.2, label='as found')
    for layer in plan.layers:
        axis.plot(x, layer.target_after[row] * 1e3, lw=0.8)
    axis.plot(x, plan.nominal.z[row] * 1e3, 'r--', lw=1, label='nominal')
    axis.set(
        title=f'section at y = {plan.spec.y[row] * 1e3:.1f} mm', xlabel='x, mm', ylabel='z, mm'
    )
    axis.legend(fontsize=7)


def _draw_layer(plan: Plan, layer: PlannedLayer, axis: Axes) -> None:
    """Metal as a map; path blue with the arc on, dashed grey without, starts green, ends red."""
    metal = np.where(layer.footprint, layer.planned, np.nan) * 1e3
    title = f'layer {layer.number}: {layer.beads} beads, {layer.arc_starts} arcs'
    top = 1e3 * MAX_LAYER_RATIO * plan.settings.layer_height
    _map(plan, axis, metal, title, 'metal, mm', cmap='YlOrBr', vmin=0, vmax=top)
    runs: list[tuple[bool, list]] = []
    for s in drawn(layer.segments, plan.settings):
        if not runs or runs[-1][0] != s.arc or math.dist(runs[-1][1][-1], s.start) > APART:
            runs.append((s.arc, [s.start]))
        runs[-1][1].append(s.end)
    burning = [False, *(arc for arc, _ in runs), False]
    for k, (arc, points) in enumerate(runs):
        line = np.array(points)[:, :2] * 1e3
        axis.plot(
            *line.T, '-' if arc else '--', c='tab:blue' if arc else 'gray', lw=0.9 if arc else 0.6
        )
        if arc and not burning[k]:
            axis.plot(*line[0], 'o', c='tab:green', ms=4)
        if arc and not burning[k + 2]:
            axis.plot(*line[-1], 's', c='tab:red', ms=3)
    axis.set_aspect('equal')
