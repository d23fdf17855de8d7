"""What a planned layer leaves if the planner's process model is right: the footprint of the pool (allocate.py)."""

from __future__ import annotations

import numpy as np

from waam_plan.fill.path import Pieces
from waam_plan.layers.allocate import footprints
from waam_plan.plan import PlannedLayer
from waam_plan.settings import PlanSettings
from waam_process.bead import bead_section
from waam_process.grid import GridSpec
from waam_process.segment import Kind


def pieces_of(layer: PlannedLayer) -> Pieces:
    """What a layer lays with the arc on; a chain reaches from arc on to arc off."""
    start, end, bead, chain = [], [], [], []
    chains, burning = 0, False
    for s in layer.segments:
        chains += s.arc and not burning
        burning = s.arc
        if s.kind == Kind.DEPOSIT and s.length > 0:
            start.append(s.start)
            end.append(s.end)
            bead.append(s.bead)
            chain.append(chains)
    begin, finish = (np.array(p, float).reshape(-1, 3) for p in (start, end))
    return Pieces(begin, finish, np.array(bead, int), np.array(chain, int))


def growth(layer: PlannedLayer, spec: GridSpec, settings: PlanSettings) -> np.ndarray:
    """(rows, cols) m of metal that the segments of a layer lay, spread as the melt pool spreads it."""
    pieces = pieces_of(layer)
    if not len(pieces.bead):
        return np.zeros(spec.shape)
    section = [float(bead_section(s.width, s.height)) for s in layer.deposits if s.length > 0]
    volume = footprints(pieces, spec, settings) @ (np.array(section) * pieces.length)
    return volume.reshape(spec.shape) / spec.resolution**2
