"""Metal as a film: what melts is poured as a bump and levels as a height field while the pool is over it, then freezes.

Inside the pool, a circle of one bead width behind the arc, the surface z obeys dz/dt = div(D (f/h) grad(z + pressure)),
with f the thickness that is molten and h the bead's height: the equation of a viscous film (Oron, Davis and Bankoff
1997, Rev. Mod. Phys. 69, 931) with the mobility linear in f, whose front stays sharp and whose section is a parabola
(Barenblatt 1952). The arc presses the melt away from under it, which leaves a crater where it ends; some of the ground
melts again and levels as well. Every flow takes from one cell what it gives to another. Lengths in m, times in s.
"""

from __future__ import annotations

import math

import numpy as np

from .compiled import inner
from .pool import REFERENCE_TEMPERATURE, laid, make_advance, melted, touch

STABLE = 0.2  # of D f/h dt/cell^2 in one step of the film
MAX_STEPS = 24  # of the film for one portion
UNSUPPORTED_BEAD_HEIGHTS = 1.5  # bead heights below the pool from which on nothing carries it
HOT_MOBILITY = 1.5e-3  # gain of mobility per kelvin above the reference
WARM_PATH = 6e-3  # m on which the width comes up after a start
EDGE_FLOW = 0.1  # share of the flow that goes where nothing is below
FREEZING = 0.08  # s that the pool stays liquid after the arc
ARC_RADIUS = 0.22  # bead widths, of the arc's pressure


@inner
def _pour(z, p, s, inside, r0, c0, volume):
    """Adds volume (m^3) as a half ellipsoid at the pool; inside (rows, cols): 1 in the pool."""
    rows, cols = inside.shape
    share = np.zeros((rows, cols))
    radius = p.film_bump * 0.5 * s.width
    total = 0.0
    for i in range(rows):
        dy = s.origin_y + (r0 + i + 0.5) * p.cell - s.pool_y
        for j in range(cols):
            dx = s.origin_x + (c0 + j + 0.5) * p.cell - s.pool_x
            q = 1.0 - (dx * dx + dy * dy) / (radius * radius)
            if q > 0.0 and inside[i, j] > 0.0:
                share[i, j] = math.sqrt(q)
                total += share[i, j]
    if total <= 0.0:
        s.lost += volume
        return
    for i in range(rows):
        for j in range(cols):
            z[r0 + i, c0 + j] += volume * share[i, j] / (total * p.cell * p.cell)


@inner
def _level(z, solid, p, s, inside, press, r0, c0, floor, rate, steps):
    """Lets the film flow inside the pool: `steps` steps of `rate` = D dt/cell^2 each. press (rows, cols): m of the
    arc's pressure; floor: m, ground below it carries nothing."""
    rows, cols = inside.shape
    change = np.zeros((rows, cols))
    widest = 0.24 * s.height  # no cell gives more than it may in a step
    for _ in range(steps):
        change[:] = 0.0
        for i in range(rows):
            for j in range(cols):
                if inside[i, j] == 0.0:
                    continue
                r, c = r0 + i, c0 + j
                for side in range(2):
                    m, n = (i, j + 1) if side == 0 else (i + 1, j)
                    if m >= rows or n >= cols or inside[m, n] == 0.0:
                        continue
                    k, q = r0 + m, c0 + n
                    fall = z[r, c] + press[i, j] - z[k, q] - press[m, n]
                    if fall > 0.0:
                        thick, below = z[r, c] - solid[r, c], solid[k, q]
                    else:
                        thick, below = z[k, q] - solid[k, q], solid[r, c]
                    if thick <= 0.0:
                        continue
                    fall = min(max(fall, -s.height), s.height)
                    flow = rate * min(thick / s.height, 2.0) * fall
                    if below < floor:
                        flow *= EDGE_FLOW
                    most = min(widest, 0.2 * thick)
                    flow = min(max(flow, -most), most)
                    change[i, j] -= flow
                    change[m, n] += flow
        for i in range(rows):
            for j in range(cols):
                z[r0 + i, c0 + j] += change[i, j]


@inner
def _run(z, solid, touched, p, s, volume, duration, pressure, temperature, time):
    """Pours volume (m^3) at the pool and lets the film level for `duration` s."""
    radius = 0.5 * s.width
    r0, r1, c0, c1 = touch(
        z, solid, touched, p, s, x=s.pool_x, y=s.pool_y, radius=radius, depth=p.film_remelt, time=time
    )  # fmt: skip
    inside, press = np.zeros((r1 - r0, c1 - c0)), np.zeros((r1 - r0, c1 - c0))
    spot = ARC_RADIUS * s.width
    highest, thickest = -1e9, 0.0
    for i in range(r1 - r0):
        y = s.origin_y + (r0 + i + 0.5) * p.cell
        for j in range(c1 - c0):
            x = s.origin_x + (c0 + j + 0.5) * p.cell
            away = (x - s.pool_x) ** 2 + (y - s.pool_y) ** 2
            if away > radius * radius:
                continue
            inside[i, j] = 1.0
            if away <= 0.1 * radius * radius:
                highest = max(highest, solid[r0 + i, c0 + j])
            arc = (x - s.x) ** 2 + (y - s.y) ** 2
            press[i, j] = pressure * s.height * math.exp(-arc / (spot * spot))
    if volume > 0.0:
        _pour(z, p, s, inside, r0, c0, volume)
    level, n = 0.0, 0
    for i in range(r1 - r0):
        for j in range(c1 - c0):
            if inside[i, j] > 0.0:
                thickest = max(thickest, z[r0 + i, c0 + j] - solid[r0 + i, c0 + j])
                near = (s.origin_x + (c0 + j + 0.5) * p.cell - s.pool_x) ** 2 + (
                    s.origin_y + (r0 + i + 0.5) * p.cell - s.pool_y
                ) ** 2 <= 0.1 * radius * radius
                if near and solid[r0 + i, c0 + j] >= highest - UNSUPPORTED_BEAD_HEIGHTS * s.height:
                    level += solid[r0 + i, c0 + j] + p.film_remelt
                    n += 1
    if n > 0:
        s.surface = level / n
    hot = 1.0 + HOT_MOBILITY * (temperature - REFERENCE_TEMPERATURE)
    mobility = p.film_mobility * max(hot, 0.2)
    rate = mobility * duration / (p.cell * p.cell)
    wanted = rate * min(thickest / s.height, 2.0) / STABLE
    steps = min(max(int(math.ceil(wanted)), 1), MAX_STEPS)
    floor = s.surface - UNSUPPORTED_BEAD_HEIGHTS * s.height
    _level(z, solid, p, s, inside, press, r0=r0, c0=c0, floor=floor, rate=rate / steps, steps=steps)


@inner
def _take(z, solid, touched, p, s, values, height_z, temperature, time):
    """Pours what has melted since the last portion, behind the arc, and lets it level as long as that took."""
    duration = s.carry_time
    volume = melted(p, s, values, height_z, temperature, p.film_hot_start, WARM_PATH)
    trail = p.film_trail * s.width
    behind = trail * (1.0 - math.exp(-s.path / trail))
    s.pool_x, s.pool_y = s.x - behind * s.dir_x, s.y - behind * s.dir_y
    _run(
        z, solid, touched, p, s, volume=volume, duration=duration, pressure=p.film_pressure,
        temperature=temperature, time=time,
    )  # fmt: skip
    laid(s, volume, s.pool_x, s.pool_y)


@inner
def _end(z, solid, touched, p, s, values, height_z, temperature, time):
    """The last portion, and what flows until the pool is solid."""
    if s.volume > 0.0:
        _take(
            z, solid, touched, p, s, values, height_z=height_z, temperature=temperature, time=time
        )
    if s.width > 0.0:
        _run(
            z, solid, touched, p, s, volume=0.0, duration=FREEZING, pressure=0.0, temperature=temperature, time=time,
        )  # fmt: skip


advance = make_advance(_take, _end)
