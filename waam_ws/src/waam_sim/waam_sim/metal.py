"""Where the molten wire ends up: a height field on which beads are laid, volume for volume.

The melt arrives in small portions (every 0.2 mm of path or 20 ms). One portion is spread as a half ellipsoid over the
pool, a circle of one bead width; along a straight path half ellipsoids add up to a parabolic section. The share of a
cell is raised where the solid below is lower than the pool's mean level and reduced where it is higher, so that beads
merge with their neighbours and fill valleys. Metal on a slope that is too steep for the melt runs down (edge slump).
The pool trails the arc: the first millimetres get more metal (start hump), the last ones less, and the arc's pressure
leaves a crater. All of these move metal, none creates any. Lengths in m, times in s, temperatures in degrees Celsius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

from .compiled import inner, jit, record, state
from .metal_params import MetalParams
from .pool import (
    ARC_REACH,
    MIN_WIDTH,
    REFERENCE_TEMPERATURE,
    RESOLIDIFIED_AFTER,
    box,
    make_advance,
    melted,
)

_STATE = (
    'origin_x', 'origin_y', 'active', 'x', 'y', 'pool_x', 'pool_y', 'head_x', 'head_y', 'from_x', 'from_y', 'path',
    'volume', 'carry_path', 'carry_time', 'power', 'speed', 'width', 'height', 'surface', 'deposited', 'lost',
    'portion', 'portion_x', 'portion_y',
    'dir_x', 'dir_y', 'store',  # of the other models, `pool`
)  # fmt: skip


@dataclass
class Metal:
    """The height field and the melt pool. `z`: (rows, cols) surface in the work frame, m."""

    spec: GridSpec
    z: np.ndarray
    params: np.ndarray
    state: np.ndarray
    solid: np.ndarray
    touched: np.ndarray

    @classmethod
    def on(cls, part: HeightGrid, params: MetalParams) -> Metal:
        """A cold work-piece; the grid must have the cell of the parameters and no unknown heights."""
        s = state(*_STATE)
        s['origin_x'], s['origin_y'] = part.spec.origin_x, part.spec.origin_y
        z = np.ascontiguousarray(part.z, np.float64).copy()
        return cls(part.spec, z, record(params), s, z.copy(), np.full(z.shape, -1e9))

    def grid(self) -> HeightGrid:
        """A copy of the true surface."""
        return HeightGrid(self.spec, self.z.copy())

    @property
    def volume(self) -> float:
        """Metal above the table, m^3."""
        return float(self.z.sum()) * self.spec.resolution**2

    @property
    def deposited(self) -> float:
        """Metal that was laid on the field so far, m^3."""
        return float(self.state['deposited'][0])


@jit
def _ellipsoid(p, s, x, y, radius, r0, r1, c0, c1):
    """Heights 0..1 of a half ellipsoid over the cells of a box."""
    k = np.zeros((r1 - r0, c1 - c0))
    for i in range(r1 - r0):
        dy = s.origin_y + (r0 + i + 0.5) * p.cell - y
        for j in range(c1 - c0):
            dx = s.origin_x + (c0 + j + 0.5) * p.cell - x
            q = 1.0 - (dx * dx + dy * dy) / (radius * radius)
            k[i, j] = math.sqrt(q) if q > 0.0 else 0.0
    return k


@jit
def _weigh(k, solid, level, mean, reach, levelling, height, overhang):
    """Turns the half ellipsoid into shares of metal: more into the low, little over an edge. Returns their sum."""
    total = 0.0
    for i in range(k.shape[0]):
        for j in range(k.shape[1]):
            if k[i, j] <= 0.0:
                continue
            b = min(solid[i, j], level + reach)
            share = max(
                k[i, j] + levelling * (mean - b) / height * math.sqrt(k[i, j]), 0.05 * k[i, j]
            )
            unsupported = min(max((level - b) / reach - 1.0, 0.0), 1.0)
            k[i, j] = share + unsupported * (overhang * k[i, j] - share)
            total += k[i, j]
    return total


@jit
def _levels(k, solid, reach):
    """Level of the pool's core, and mean level of what supports the pool. The arc burns to what is near: of a core that
    hangs over an edge the ground below does not count."""
    core, n = 0.0, 0.0
    limit = 0.866 if k.max() > 0.866 else 0.0
    highest = -1e9
    for i in range(k.shape[0]):
        for j in range(k.shape[1]):
            if k[i, j] > limit:
                highest = max(highest, solid[i, j])
    for i in range(k.shape[0]):
        for j in range(k.shape[1]):
            if k[i, j] > limit and solid[i, j] >= highest - ARC_REACH:
                core += k[i, j] * solid[i, j]
                n += k[i, j]
    core /= n
    mean, n = 0.0, 0.0
    for i in range(k.shape[0]):
        for j in range(k.shape[1]):
            if k[i, j] > 0.0 and solid[i, j] >= core - reach:
                mean += k[i, j] * min(solid[i, j], core + reach)
                n += k[i, j]
    return core, (mean / n if n > 0.0 else core)


@jit
def _slump(z, solid, k, r0, c0, steepest, cell, rate):
    """Fresh metal on slopes beyond `steepest` runs to the lower neighbour; what one cell loses another gains."""
    rows, cols = k.shape
    change = np.zeros((rows, cols))
    for i in range(rows):
        for j in range(cols):
            if k[i, j] <= 0.0:
                continue
            r, c = r0 + i, c0 + j
            mobile = rate * max(z[r, c] - solid[r, c], 0.0)
            if mobile <= 0.0:
                continue
            for di, dj in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                m, n = i + di, j + dj
                if m < 0 or n < 0 or m >= rows or n >= cols:
                    continue
                excess = z[r, c] - z[r0 + m, c0 + n] - steepest * cell
                if excess > 0.0:
                    flow = min(0.2 * excess, mobile)
                    change[i, j] -= flow
                    change[m, n] += flow
    for i in range(rows):
        for j in range(cols):
            z[r0 + i, c0 + j] += change[i, j]


@inner
def lay(z, solid, touched, p, s, x, y, volume, width, height, temperature, time):
    """Spreads one portion of melt (m^3) over the pool around (x, y) and lets it slump. Outside the field it is lost."""
    radius = 0.5 * width
    r0, r1, c0, c1 = box(z.shape, p, s, x, y, radius)
    k = _ellipsoid(p=p, s=s, x=x, y=y, radius=radius, r0=r0, r1=r1, c0=c0, c1=c1)
    if k.size == 0 or k.max() <= 0.0:
        s.lost += volume
        return
    for i in range(r1 - r0):
        for j in range(c1 - c0):
            if k[i, j] > 0.0:
                if abs(time - touched[r0 + i, c0 + j]) > RESOLIDIFIED_AFTER:
                    solid[r0 + i, c0 + j] = z[r0 + i, c0 + j]
                touched[r0 + i, c0 + j] = time
    hot = temperature - REFERENCE_TEMPERATURE
    below = solid[r0:r1, c0:c1]
    reach = 1.5 * height
    level, mean = _levels(k, below, reach)
    levelling = min(max(p.levelling + p.hot_levelling_per_k * hot, 0.0), 1.0)
    total = _weigh(k, below, level, mean, reach, levelling, height, p.overhang_share)
    scale = volume / (total * p.cell * p.cell)
    for i in range(r1 - r0):
        for j in range(c1 - c0):
            z[r0 + i, c0 + j] += scale * k[i, j]
    s.deposited += volume
    s.surface = level
    steepest = min(max(p.slump_slope - p.hot_slump_per_k * hot, 0.6), 3.0 * p.slump_slope)
    _slump(z, solid, k, r0, c0, steepest, p.cell, p.slump_rate)


@inner
def dig_crater(z, solid, p, s):
    """The arc's last pressure: moves metal of the pool to the bead behind it. Short beads keep their shape, and where
    little of the bead lies behind (round a corner, on a bead that had gone solid before) the crater is shallower."""
    if s.path < 2.0 * s.width:
        return
    tail_x, tail_y = s.pool_x - 0.9 * s.width * s.head_x, s.pool_y - 0.9 * s.width * s.head_y
    t0, t1, u0, u1 = box(z.shape, p, s, tail_x, tail_y, 0.6 * s.width)
    tail = _ellipsoid(
        p=p, s=s, x=tail_x, y=tail_y, radius=0.6 * s.width, r0=t0, r1=t1, c0=u0, c1=u1,
    )  # fmt: skip
    for i in range(t1 - t0):
        for j in range(u1 - u0):
            tail[i, j] *= (
                1.0 if z[t0 + i, u0 + j] - solid[t0 + i, u0 + j] > 0.25 * s.height else 0.0
            )
    total = tail.sum() if tail.size else 0.0
    if total <= 0.0:
        return
    x, y = s.pool_x - 0.1 * s.width * s.head_x, s.pool_y - 0.1 * s.width * s.head_y
    r0, r1, c0, c1 = box(z.shape, p, s, x, y, 0.3 * s.width)
    bowl = _ellipsoid(p=p, s=s, x=x, y=y, radius=0.3 * s.width, r0=r0, r1=r1, c0=c0, c1=c1)
    moved = 0.0
    for i in range(r1 - r0):
        for j in range(c1 - c0):
            fresh = max(z[r0 + i, c0 + j] - solid[r0 + i, c0 + j], 0.0)
            bowl[i, j] = min(p.crater_depth * s.height * bowl[i, j] ** 2, 0.7 * fresh)
            moved += bowl[i, j]
    room = p.crater_depth * s.height * total  # no cell of the tail rises by more than the depth
    share = min(1.0, room / moved) if moved > 0.0 else 0.0
    for i in range(r1 - r0):
        for j in range(c1 - c0):
            z[r0 + i, c0 + j] -= share * bowl[i, j]
    moved *= share
    for i in range(t1 - t0):
        for j in range(u1 - u0):
            z[t0 + i, u0 + j] += moved * tail[i, j] / total


@jit
def _follow(p, s, x, y, step, dt):
    """The pool follows the arc: half at once, the rest with the distance between them, slowly even at rest."""
    gap_x, gap_y = x - s.pool_x, y - s.pool_y
    gap = math.hypot(gap_x, gap_y)
    if gap <= 0.0:
        return
    lag = p.pool_lag * max(s.width, MIN_WIDTH)
    share = min(step * (0.5 / gap + 0.5 / lag) + dt / p.pool_lag_time, 1.0)
    s.pool_x += share * gap_x
    s.pool_y += share * gap_y


@inner
def _take(z, solid, touched, p, s, values, height_z, temperature, time):
    """Lays what has melted since the last portion."""
    volume = melted(p, s, values, height_z, temperature, p.start_narrowing, p.start_length)
    lay(
        z=z, solid=solid, touched=touched, p=p, s=s, x=s.pool_x, y=s.pool_y, volume=volume, width=s.width,
        height=s.height, temperature=temperature, time=time,
    )  # fmt: skip
    s.portion, s.portion_x, s.portion_y = s.portion + volume, s.pool_x, s.pool_y
    s.carry_path, s.carry_time = 0.0, 0.0


@inner
def _end(z, solid, touched, p, s, values, height_z, temperature, time):
    """The last portion, and the crater."""
    if s.volume > 0.0:
        _take(
            z, solid, touched, p, s, values, height_z=height_z, temperature=temperature, time=time
        )
    dig_crater(z, solid, p, s)


advance = make_advance(_take, _end, _follow)
