"""What varies around the metal model, whichever it is: the place of the wire, how much of it arrives, lumps of spatter.

The wire leaves the tip with a cast, so metal is laid beside the commanded path. A layer as a whole gets more or less
metal than the one before; the deposition efficiency drifts with layers and wire and walks at random. Drops of spatter
freeze on the surface around the pool. All of it acts on what a metal model is given (place, wire speed) or on its
surface, never within it. Numbers come from the seed, the path with burning arc and the number of the layer, not from
time: jobs whose clocks differ meet the same. A parameter of 0 turns its part off. Lengths m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_node.params import param

from .compiled import STRIDE, jit, mixed, random_state, record, state
from .placement import METAL

ACROSS_X, ACROSS_Y, LAYER, WALK, LUMP, CURRENT, VOLTAGE = range(7)  # streams of `white`
NODE = 0.825  # of smooth noise: path over distance of two nodes at which its autocorrelation has fallen to 1/e
LAYER_PAUSE = 8.0  # s without arc after which a layer begins; after a scan one begins, too
# m, mean height and diameter of a lump (assumed: the recorded wall has none), and how far from the arc one falls
LUMP_HEIGHT, LUMP_DIAMETER, LUMP_REACH = 4e-4, 1.2e-3, 0.015
LUMP_PATH = 1e-3  # m of path on which at most one lump falls
MIN_WIRE_SHARE = 0.1  # share of the wire that arrives at least


@dataclass(frozen=True)
class VariationParams:
    """Variation of the process that no metal model knows of. As shipped there is none."""

    lateral: float = param(
        0.0,
        'sigma of the place of the wire beside the commanded path, in x and in y',
        'm',
        0.0,
        2e-3,
    )
    lateral_length: float = param(
        0.02, 'path on which its autocorrelation falls to 1/e', 'm', 1e-3, 1.0
    )
    layer: float = param(0.0, 'sigma of metal that is common to a layer', '', 0.0, 0.3)
    efficiency_per_layer: float = (
        0.0  # relative change of the deposition efficiency from layer to layer
    )
    efficiency_walk: float = param(
        0.0, 'sigma of a random step of the deposition efficiency at every layer', '', 0.0, 0.2
    )
    lumps: float = param(0.0, 'lumps of spatter that stay, by path', '1/m', 0.0, 500.0)


_STATE = ('path', 'idle', 'scanned', 'layers', 'walk', 'gain', 'lumps', 'last_x', 'last_y')


@dataclass
class Variation:
    """State: path (m) with burning arc, s without arc, number of layers, share of the wire that arrives, lumps."""

    params: np.ndarray
    state: np.ndarray
    key: np.ndarray  # (1,) uint64, names all its random numbers

    @classmethod
    def of(cls, params: VariationParams, seed: int) -> Variation:
        """Before the first layer."""
        s = state(*_STATE)
        s['gain'], s['last_x'] = 1.0, np.nan
        return cls(record(params), s, random_state(seed, 8))

    def scanned(self) -> None:
        """The part was scanned: what is laid next is another layer."""
        self.state['scanned'] = 1.0


@jit
def white(key, stream, number, part):
    """Number in (0, 1) by stream, number (not negative) and part of it: the same whenever it is asked for."""
    word = key + STRIDE * (np.uint64(stream * 8 + part) + np.uint64(1))
    word = mixed(word) + STRIDE * (np.uint64(number) + np.uint64(1))
    return (np.float64(mixed(word) >> np.uint64(11)) + 0.5) * (1.0 / 9007199254740992.0)


@jit
def gauss(key, stream, number):
    """Standard normal number by stream and number (Box and Muller 1958)."""
    u, v = white(key, stream, number, 0), white(key, stream, number, 1)
    return math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)


@jit
def smooth(key, stream, along, length):
    """Unit-variance noise along a path or a time (along >= 0), correlated over `length`: normal numbers at nodes,
    blended between them with constant variance."""
    u = along * NODE / length
    i = int(u)
    f = u - i
    f = f * f * (3.0 - 2.0 * f)
    low, high = gauss(key, stream, i), gauss(key, stream, i + 1)
    return ((1.0 - f) * low + f * high) / math.sqrt(f * f + (1.0 - f) * (1.0 - f))


@jit
def beside(p, s, key):
    """(m, m): where the wire is beside the torch."""
    if p.lateral == 0.0:
        return 0.0, 0.0
    dx = p.lateral * smooth(key[0], ACROSS_X, s.path, p.lateral_length)
    dy = p.lateral * smooth(key[0], ACROSS_Y, s.path, p.lateral_length)
    return dx, dy


@jit
def pass_path(s, x, y, lit, dt):
    """One sample: the torch is at (x, y)."""
    if lit and not math.isnan(s.last_x):
        s.path += math.hypot(x - s.last_x, y - s.last_y)
    s.idle = 0.0 if lit else s.idle + dt
    s.last_x, s.last_y = x, y


@jit
def strike(p, s, key, idle):
    """The arc strikes after `idle` s without it: perhaps a layer begins."""
    if s.layers > 0.0 and s.scanned == 0.0 and idle < LAYER_PAUSE:
        return
    s.scanned = 0.0
    s.layers += 1.0
    if s.layers > 1.0 and p.efficiency_walk > 0.0:
        s.walk += p.efficiency_walk * gauss(key[0], WALK, int(s.layers))
    s.gain = 1.0 + p.layer * gauss(key[0], LAYER, int(s.layers)) if p.layer > 0.0 else 1.0


@jit
def arriving(p, s):
    """Share of the wire that arrives beside what the metal model knows."""
    drift = p.efficiency_per_layer * max(s.layers - 1.0, 0.0) + s.walk
    return max(s.gain * (1.0 + drift), MIN_WIRE_SHARE)


@jit
def spatter(p, s, key, z, origin_x, origin_y, cell, x, y, pool, before):
    """Lumps that fell while the path grew from `before` (m) with the arc at (x, y): none into the pool (radius, m),
    none on the table. Raises z (rows, cols); returns the metal of it, m^3."""
    first, last = int(before / LUMP_PATH), int(s.path / LUMP_PATH)
    added = 0.0
    for k in range(first, last):
        if white(key[0], LUMP, k, 0) >= p.lumps * LUMP_PATH:
            continue
        away = LUMP_REACH * math.sqrt(white(key[0], LUMP, k, 1))
        angle = 2.0 * math.pi * white(key[0], LUMP, k, 2)
        size = 0.5 + white(key[0], LUMP, k, 3)
        radius, height = 0.5 * size * LUMP_DIAMETER, size * LUMP_HEIGHT
        if away < pool + radius:
            continue
        at_x, at_y = x + away * math.cos(angle), y + away * math.sin(angle)
        metal = _lump(z, origin_x, origin_y, cell, at_x, at_y, radius, height)
        s.lumps += 1.0 if metal > 0.0 else 0.0
        added += metal
    return added


@jit
def _lump(z, origin_x, origin_y, cell, x, y, radius, height):
    """A half ellipsoid on the metal at (x, y); m^3."""
    c0 = max(int(math.floor((x - radius - origin_x) / cell)), 0)
    c1 = min(int(math.floor((x + radius - origin_x) / cell)) + 1, z.shape[1])
    r0 = max(int(math.floor((y - radius - origin_y) / cell)), 0)
    r1 = min(int(math.floor((y + radius - origin_y) / cell)) + 1, z.shape[0])
    added = 0.0
    for r in range(r0, r1):
        dy = origin_y + (r + 0.5) * cell - y
        for c in range(c0, c1):
            dx = origin_x + (c + 0.5) * cell - x
            q = 1.0 - (dx * dx + dy * dy) / (radius * radius)
            if q > 0.0 and z[r, c] > METAL:
                z[r, c] += height * math.sqrt(q)
                added += height * math.sqrt(q) * cell * cell
    return added
