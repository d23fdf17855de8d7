"""How the part lies: warped by the heat of the arc, and moved since it was scanned. Lengths m, heat J, times s.

Metal is laid in the part's own coordinates (metal.py); what this module gives is added wherever height counts: between
torch and metal, for the scanner and for the distance sensor. Every portion of heat lifts the metal around it (a bell of
width `warp_reach`), less the closer the place is to its greatest rise. A share of the rise stays, the rest goes back
while the part cools. That is the look of thermal distortion, not a solution of its mechanics.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waam_node.params import param
from waam_process.grid import GridSpec

from .compiled import SOURCES, bilinear, jit, normal, record, state

METAL = 1e-4  # m above the table: lower is table, which stays where it is


@dataclass(frozen=True)
class PlacementParams:
    """Warping while the part is welded, and how wrong the map of the first scan is."""

    warp: float = param(
        0.0, 'rise by heat at which a place warps no further; negative = sinks', 'm', -0.01, 0.01
    )
    warp_energy: float = param(
        1.2e5, 'electrical heat at a place that brings it two thirds of the way', 'J', 1e3, 1e8
    )
    warp_spread: float = 0.3  # sigma of the logarithm of that heat between parts
    warp_reach: float = 0.03  # distance from the arc at which its lift has fallen to 60 % [m]
    warp_kept: float = 0.4  # share of the rise that stays in the cold part
    warp_cooling: float = 90.0  # time in which the rest goes back [s]
    moved_z: float = param(0.0, 'the part lies higher than in the first scan', 'm', -0.02, 0.02)
    moved_tilt_x: float = 0.0  # and rises along x about its middle [m/m]
    moved_tilt_y: float = 0.0  # and along y [m/m]
    moved_step: float = param(0.0, 'and is higher by a step on the far side in x', 'm', -0.02, 0.02)
    moved_step_x: float = math.nan  # where that step is, work frame; NaN = middle of the part [m]


_STATE = (
    'origin_x',
    'origin_y',
    'cell',
    'middle_x',
    'middle_y',
    'heat',
    'energy',
    'x',
    'y',
    'moved',
)


@dataclass
class Placement:
    """Rises of the cells of the heat field, (rows, cols), m: what goes back when cold, and what stays."""

    params: np.ndarray
    state: np.ndarray
    hot: np.ndarray
    kept: np.ndarray

    @classmethod
    def flat(
        cls, params: PlacementParams, spec: GridSpec, middle: tuple[float, float], rng: np.ndarray
    ) -> Placement:
        """A part that lies as it was scanned."""
        s = state(*_STATE)
        s['origin_x'], s['origin_y'], s['cell'] = spec.origin_x, spec.origin_y, spec.resolution
        s['middle_x'], s['middle_y'] = middle
        s['heat'] = params.warp_energy * math.exp(params.warp_spread * normal(rng))
        p = record(params)
        if math.isnan(params.moved_step_x):
            p['moved_step_x'] = middle[0]
        return cls(p, s, np.zeros(spec.shape), np.zeros(spec.shape))

    def at(self, x: float, y: float) -> float:
        """Rise at a place of the part, m."""
        return float(rise(self.hot, self.kept, self.params[0], self.state[0], x, y))

    def over(self, spec: GridSpec, z: np.ndarray) -> np.ndarray:
        """Heights (rows, cols) of the part's own field `z` as they are in the work frame, m."""
        out = z.copy()
        raise_field(
            self.hot,
            self.kept,
            self.params,
            self.state,
            spec.origin_x,
            spec.origin_y,
            spec.resolution,
            out,
        )
        return out


def _make_rise(sources: int) -> Callable:
    @jit
    def rise(hot, kept, p, s, x, y):
        """m, at a place of the work frame."""
        if not sources:
            return 0.0
        up = 0.0
        if p.warp != 0.0:
            up += bilinear(hot, s.origin_x, s.origin_y, s.cell, x, y, 0.0)
            up += bilinear(kept, s.origin_x, s.origin_y, s.cell, x, y, 0.0)
        if s.moved > 0.0:
            up += p.moved_z + p.moved_tilt_x * (x - s.middle_x) + p.moved_tilt_y * (y - s.middle_y)
            if x > p.moved_step_x:
                up += p.moved_step
        return up

    return rise


rise = _make_rise(SOURCES)


@jit
def warm(p, s, x, y, energy):
    """Heat of the arc (J) at a place, until the next `distort`. A part that was never scanned has moved by then."""
    s.energy += energy
    s.x, s.y = x, y
    s.moved = 1.0


@jit
def distort(hot, kept, p, s, dt):
    """What the heat since the last call has done, and what cooling has taken back."""
    if p.warp == 0.0:
        return
    back = math.exp(-dt / p.warp_cooling)
    gain = s.energy / s.heat
    for r in range(hot.shape[0]):
        dy = s.origin_y + (r + 0.5) * s.cell - s.y
        for c in range(hot.shape[1]):
            hot[r, c] *= back
            if gain > 0.0:
                dx = s.origin_x + (c + 0.5) * s.cell - s.x
                near = math.exp(-0.5 * (dx * dx + dy * dy) / (p.warp_reach * p.warp_reach))
                left = p.warp - hot[r, c] - kept[r, c]
                more = left * (1.0 - math.exp(-gain * near))
                hot[r, c] += (1.0 - p.warp_kept) * more
                kept[r, c] += p.warp_kept * more
    s.energy = 0.0


def _make_raise(sources: int) -> Callable:
    @jit
    def raise_field(hot, kept, params, states, origin_x, origin_y, cell, z):
        """Adds the rise to every height that is metal."""
        if not sources:
            return
        p, s = params[0], states[0]
        for r in range(z.shape[0]):
            for c in range(z.shape[1]):
                if z[r, c] > METAL:
                    x, y = origin_x + (c + 0.5) * cell, origin_y + (r + 0.5) * cell
                    z[r, c] += rise(hot, kept, p, s, x, y)

    return raise_field


raise_field = _make_raise(SOURCES)
