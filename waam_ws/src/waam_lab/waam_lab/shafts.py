"""Worn shafts to restore: maps of one turn (`waam_plan.shaft.surfaces`), for benchmarks and tests. Lengths in m."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

CELL = 4e-4
RAMP = 4e-3  # between the unworn end and the worn zone


@dataclass(frozen=True)
class WornShaft:
    """A shaft as it is found in its chuck. Wear: where it lies between the ends, and how deep."""

    diameter: float
    length: float
    ends: float  # unworn at each end
    wear: str  # of WEARS
    depth: float  # greatest
    run_out: tuple[float, float] = (
        0.0,
        0.0,
    )  # its axis beside the chuck's in the middle, towards 0 and 90 degrees
    tilt: tuple[float, float] = (0.0, 0.0)  # and per m along the axis
    turned: float = 0.0  # rad, of the wear around the shaft

    def map(self) -> HeightGrid:
        """One turn: z = radius - nominal radius. ValueError for a wear that is not known."""
        if self.wear not in WEARS:
            raise ValueError(f"wear is '{self.wear}', known are {', '.join(WEARS)}")
        cols = round(math.pi * self.diameter / CELL)
        cell = math.pi * self.diameter / cols
        spec = GridSpec(0.0, 0.0, cell, int(self.length / cell + 1e-9), cols)
        t, y = np.meshgrid(spec.x * 2.0 / self.diameter, spec.y)
        along = np.clip((np.minimum(y, self.length - y) - self.ends) / RAMP, 0.0, 1.0)
        fade = along * along * (3.0 - 2.0 * along)
        worn = (
            self.depth
            * fade
            * WEARS[self.wear](t - self.turned, (y - self.ends) / (self.length - 2 * self.ends))
        )
        away = y - self.length / 2
        ex, ey = (self.run_out[k] + self.tilt[k] * away for k in (0, 1))
        return HeightGrid(spec, ex * np.cos(t) + ey * np.sin(t) - worn)


def _keyway(t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A sector of 70 degrees, with soft edges."""
    away = np.abs((t + math.pi) % (2 * math.pi) - math.pi)
    return np.clip((math.radians(35.0) - away) / 0.12, 0.0, 1.0)


WEARS = {  # share of the depth at angle t (rad) and y (0..1 over the worn zone)
    'eccentric': lambda t, y: 0.6 + 0.4 * np.cos(t),
    'oval': lambda t, y: 0.7 + 0.3 * np.cos(2 * t),
    'scored': lambda t, y: 0.65 + 0.35 * np.cos(2 * math.pi * 4 * y),
    'tapered': lambda t, y: 0.4 + 0.6 * y,
    'sector': _keyway,
}
