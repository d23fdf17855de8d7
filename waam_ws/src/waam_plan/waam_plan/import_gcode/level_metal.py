"""The metal of a program's layer, shared out along its path so that the layer comes out level.

A slicer gives a line as much wire per length everywhere. That is too much where lines run close, as where infill
overlaps a perimeter and inside turns, and too little at gaps. Plans of our own share the metal out by what each piece
of path adds to the surface (`layers.allocate`); here the same is done for a path of others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from waam_plan.fill.path import Pieces
from waam_plan.import_gcode.targets import MIN_THICKNESS, Target
from waam_plan.layers.allocate import metal_heights
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

# Relative layer height that a correction may ask for. The outermost line of a slicer lies along a free side, and what
# is asked for beyond this runs down there (docs/planning.md).
RATIO_HIGH = 1.8


def levelled(
    runs: list[list[Segment]], wanted: Target, spec: GridSpec, settings: PlanSettings
) -> list[list[Segment]]:
    """The segments of each bead with the metal that lays `wanted.planned`; where they lie and how fast they run stays.

    runs: with their own metal. Pieces without length keep theirs.
    """
    pieces = _pieces(runs)
    if not len(pieces.bead) or not wanted.footprint.any():
        return runs
    thick = float(np.clip(np.median(wanted.planned[wanted.footprint]), MIN_THICKNESS, 5e-3))
    own = replace(settings, layer_height=thick)  # of this layer: it bounds what a piece may carry
    height = metal_heights(pieces, wanted.planned, wanted.footprint, spec, own)
    of_piece = iter(height.tolist())
    return [[_laid(s, next(of_piece), settings) if _counts(s) else s for s in run] for run in runs]


def _counts(s: Segment) -> bool:
    return s.kind == Kind.DEPOSIT and s.length > 0


def _pieces(runs: list[list[Segment]]) -> Pieces:
    """What lays metal; every stretch with the arc on is a bead and a chain."""
    laid = [(i, s) for i, run in enumerate(runs) for s in run if _counts(s)]
    bead = np.array([i for i, _ in laid], int)
    ends = np.array([(s.start, s.end) for _, s in laid], float).reshape(-1, 2, 3)
    return Pieces(ends[:, 0], ends[:, 1], bead, bead)


def _laid(s: Segment, height: float, settings: PlanSettings) -> Segment:
    """With another metal and the wire that it takes. height: m, of a bead of the settings' width."""
    share = height * settings.bead_width / (s.height * s.width)
    return s.at(height=height, width=settings.bead_width, wire_feed_speed=s.wire_feed_speed * share)
