"""One layer of metal, of a build or of a restoration: from what is wanted at each place to the segments that lay it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_plan import masks
from waam_plan.fill import path
from waam_plan.fill.hatch import Chain
from waam_plan.fill.inside import keep_inside
from waam_plan.layers.allocate import edge_surplus, metal_heights
from waam_plan.layers.travel import Ceiling, to_segments
from waam_plan.plan import PlannedLayer
from waam_plan.settings import PlanSettings
from waam_plan.shaft import lines
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Point


@dataclass(frozen=True)
class LayerTask:
    """What one layer should become. Maps are (rows, cols), heights in m."""

    number: int  # from 1, the lowest of the plan
    turn: int  # that directions alternate by: `number`, and the layers that lay there before
    footprint: np.ndarray  # bool, cells that get metal
    planned: np.ndarray  # metal to add, 0 outside the footprint
    before: np.ndarray  # surface wanted before the layer, NaN = do not care
    after: np.ndarray  # surface wanted after the layer, NaN = do not care
    ground: np.ndarray  # what the torch follows
    metal: np.ndarray  # what idle moves pass over
    inside: list | None = None  # polygons that the path may not leave
    cover: np.ndarray | None = (
        None  # bool, cells that beads cover: with what overruns the sides; None = footprint
    )
    slower: float = 1.0  # factor of the travel speed
    thickest: float | None = None  # m, of the layer at any place; None = by max_layer_ratio


def bead_direction(footprint: np.ndarray, settings: PlanSettings, turn: int) -> Point:
    """Unit vector of the beads."""
    along_x = path.choose_direction(footprint, settings, turn) == 'x'
    return (1.0, 0.0, 0.0) if along_x else (0.0, 1.0, 0.0)


def lay(
    task: LayerTask,
    chains: list[Chain],
    starts: np.ndarray,
    *,
    spec: GridSpec,
    safe_z: float,
    settings: PlanSettings,
) -> PlannedLayer:
    """Shares the metal out along the chains (m, work frame) and adds the ways between them.

    starts: (n, 2) m, arc starts of the layer below, which those of this one keep away from.
    """
    shaft = settings.unrolled
    chains = lines.spread(chains, starts, settings)
    pieces = path.lay_out(chains, HeightGrid(spec, task.ground), settings)
    if task.inside is not None and not shaft:
        pieces = keep_inside(pieces, task.inside)
    cover = task.footprint if task.cover is None else task.cover
    wanted = masks.spread(task.planned, task.footprint, cover)
    shown = lines.shown(pieces, shaft) if shaft else pieces
    height = metal_heights(shown, wanted, cover, spec, settings, task.thickest)
    ceiling = Ceiling.over(spec, task.metal, settings.torch_radius, shaft)
    planned, own = task.planned, pieces
    if shaft:
        height, own = height[: len(pieces.bead)], lines.first_of(shown, len(pieces.bead))
        wanted, planned = (m[:, shaft.first_turn(spec)] for m in (wanted, planned))
    aside = (wanted.sum() - planned.sum()) * spec.resolution**2
    segments = to_segments(pieces, height, task.number, ceiling, safe_z, settings, task.slower)
    return PlannedLayer(
        number=task.number,
        planned=task.planned,
        target_before=task.before,
        target_after=task.after,
        segments=lines.on_shaft(segments, shaft) if shaft else segments,
        direction=bead_direction(task.footprint, settings, task.turn),
        footprint=task.footprint,
        beside=float(aside + edge_surplus(own, height, cover, spec, settings)),
    )
