"""A program as it was read: motions in order. SI, in the program's own frame, which is the work frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waam_plan.import_gcode.arc import Arc
from waam_process.segment import Point

CHORD = 0.5e-6  # m, farthest that a chord may lie from its arc


@dataclass(frozen=True)
class Motion:
    """One move, or with `dwell` a wait. Coordinates are NaN where the program has not said them yet."""

    line: int
    start: Point
    end: Point
    speed: float  # m/s; NaN for a rapid
    rapid: bool = False
    arc: bool = False  # the electric arc burns
    # m/s of wire; NaN = the program does not say: the metal of its layer
    wire: float = math.nan
    voltage: float = 0.0  # 0 = that of the material
    dwell: float = 0.0  # s
    round: Arc | None = None  # None = a straight line
    mark: int = 0  # comments that begin a layer, so far

    @property
    def length(self) -> float:
        """Along the path, m; NaN from an unknown place."""
        return self.round.length if self.round else math.dist(self.start, self.end)

    def corners(self, tolerance: float = CHORD) -> np.ndarray:
        """(n, 3) of the path; chords lie within `tolerance` (m) of an arc."""
        if self.round:
            return self.round.chords(tolerance)
        return np.array([self.start, self.end])


@dataclass(frozen=True)
class Program:
    """name: of the file. wire_diameter: m, of the wire that the program counts in; 0 = that of the material."""

    name: str
    motions: list[Motion]
    wire_diameter: float = 0.0
    idle: str = 'keep'  # as of Dialect
    height: str = 'surface'  # as of Dialect
    remarks: list[str] = field(default_factory=list)  # what was left out, and why
    warnings: list[str] = field(default_factory=list)  # what may be meant otherwise

    @property
    def burning(self) -> list[Motion]:
        """Moves with the arc on."""
        return [m for m in self.motions if m.arc and not m.dwell]
