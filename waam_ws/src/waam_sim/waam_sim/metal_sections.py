"""Metal as sections: every step of the torch lays a parabola across its path, beside and over what lies there.

A section has the width of a single bead and, on level ground, its parabola; beside another bead the valley between the
two fills up to the tangent of both (Ding, Pan, Cuiuri and Li 2015, Robotics and Computer-Integrated Manufacturing 31,
101-110), and the section rises until its area is the wire's. So nothing flows along the bead and nothing levels what
lies below it, other than in `metal`. A store of melt travels with the torch: a bead starts narrow and high, its area
follows the wire late, and what is left when the arc ends is laid as a round cap. Lengths in m.
"""

from __future__ import annotations

import math

import numpy as np

from .compiled import bilinear, inner
from .pool import laid, make_advance, melted, splat, touch

ACROSS = 32  # pieces that a section is divided into
SMEAR = 5  # places along the path that share a section
UNSUPPORTED_BEAD_HEIGHTS = 1.5  # bead heights below the pool from which on nothing carries it
TRIES = 18  # halvings of the search for the height of a section
EDGE_SHARE = 0.35  # of its height that a section has where nothing is below
FULLEST = 6.0  # sections of one bead that the store holds at most, times pool length


@inner
def _tangents(top, first, last):
    """Upper concave hull of top[first:last], in place: straight lines over every valley."""
    stack = np.empty(last - first, np.int64)
    n = 0
    for i in range(first, last):
        while n >= 2:
            a, b = stack[n - 2], stack[n - 1]
            if (top[b] - top[a]) * (i - a) <= (top[i] - top[a]) * (b - a):
                n -= 1
            else:
                break
        stack[n] = i
        n += 1
    for k in range(n - 1):
        a, b = stack[k], stack[k + 1]
        for i in range(a + 1, b):
            top[i] = top[a] + (top[b] - top[a]) * (i - a) / (b - a)


@inner
def _section(ground, carried, base, high, fillet, top):
    """Surface `top` of a section of height `high` over `base`; ground (n,) m, carried (n,): 1 where something is below.
    Returns the sum of what it adds (m)."""
    n = ground.size
    for j in range(n):
        u = 2.0 * (j + 0.5) / n - 1.0
        dome = high * (1.0 - u * u)
        if carried[j] > 0.0:
            top[j] = max(ground[j], base + dome)
        else:
            top[j] = ground[j] + EDGE_SHARE * dome
    if fillet > 0.0:
        hull = top.copy()
        first = 0
        for j in range(n + 1):
            if j == n or carried[j] == 0.0:
                if j - first > 2:
                    _tangents(hull, first, j)
                first = j + 1
        for j in range(n):
            top[j] += fillet * (hull[j] - top[j])
    total = 0.0
    for j in range(n):
        total += top[j] - ground[j]
    return total


@inner
def _over(solid, p, s, x, y, along_x, along_y, wanted):
    """Adds (ACROSS,) m of a section of the state's width at (x, y) whose area is `wanted` m^2, and the level of the
    ground under its middle."""
    ground, carried, top = np.empty(ACROSS), np.ones(ACROSS), np.empty(ACROSS)
    piece = s.width / ACROSS
    highest = -1e9
    for j in range(ACROSS):
        u = (j + 0.5) * piece - 0.5 * s.width
        ground[j] = bilinear(
            solid, s.origin_x, s.origin_y, p.cell, x - along_y * u, y + along_x * u, -1e3
        )
        if ACROSS // 3 <= j < ACROSS - ACROSS // 3:
            highest = max(highest, ground[j])
    core, n, lowest = 0.0, 0, 1e9
    for j in range(ACROSS // 3, ACROSS - ACROSS // 3):
        if ground[j] >= highest - UNSUPPORTED_BEAD_HEIGHTS * s.height:
            core += ground[j]
            n += 1
    core /= max(n, 1)
    for j in range(ACROSS):
        if ground[j] < core - UNSUPPORTED_BEAD_HEIGHTS * s.height:
            carried[j] = 0.0
        else:
            lowest = min(lowest, ground[j])
    base = min(max(lowest, core - p.sections_sag * s.height), core)
    area = wanted / piece
    low, high = 0.0, 8.0 * s.height
    for _ in range(TRIES):
        middle = 0.5 * (low + high)
        if _section(ground, carried, base, middle, p.sections_fillet, top) < area:
            low = middle
        else:
            high = middle
    total = _section(ground, carried, base, high, p.sections_fillet, top)
    for j in range(ACROSS):
        top[j] = (top[j] - ground[j]) * (area / total if total > 0.0 else 0.0)
    return top, core


@inner
def _lay_section(z, solid, touched, p, s, volume, path, time):
    """Lays volume (m^3) as a section at the pool, `path` m of bead; it is shared out a little along the bead."""
    x, y = s.pool_x, s.pool_y
    size = math.hypot(s.dir_x, s.dir_y)
    along_x, along_y = (s.dir_x / size, s.dir_y / size) if size > 0.1 else (s.head_x, s.head_y)
    if along_x == 0.0 and along_y == 0.0:
        along_x = 1.0
    touch(
        z, solid, touched, p, s, x=x, y=y, radius=0.5 * s.width + 2.0 * p.cell, depth=0.0, time=time
    )
    added, level = _over(solid, p, s, x, y, along_x=along_x, along_y=along_y, wanted=volume / path)
    piece = s.width / ACROSS
    total = 0.0
    for j in range(ACROSS):
        total += added[j]
    for j in range(ACROSS):
        u = (j + 0.5) * piece - 0.5 * s.width
        for k in range(SMEAR):
            t = (k - SMEAR // 2) * 0.1 * s.width
            part = volume * added[j] / (total * SMEAR) if total > 0.0 else volume / (ACROSS * SMEAR)
            s.lost += splat(
                z, p, s, x - along_y * u + along_x * t, y + along_x * u + along_y * t, part
            )
    if level > -1e2:
        s.surface = level
    laid(s, volume, x, y)


@inner
def _lay_cap(z, solid, touched, p, s, volume, time):
    """Lays volume (m^3) as a round cap around the pool: where the torch stands, and what is left at a bead's end."""
    radius = 0.5 * s.width
    r0, r1, c0, c1 = touch(
        z, solid, touched, p, s, x=s.pool_x, y=s.pool_y, radius=radius, depth=0.0, time=time
    )
    share = np.zeros((r1 - r0, c1 - c0))
    for i in range(r1 - r0):
        dy = s.origin_y + (r0 + i + 0.5) * p.cell - s.pool_y
        for j in range(c1 - c0):
            dx = s.origin_x + (c0 + j + 0.5) * p.cell - s.pool_x
            q = 1.0 - (dx * dx + dy * dy) / (radius * radius)
            ahead = dx * s.head_x + dy * s.head_y >= -0.25 * radius
            fits = solid[r0 + i, c0 + j] >= s.surface - UNSUPPORTED_BEAD_HEIGHTS * s.height
            if q > 0.0 and ahead:
                share[i, j] = q if fits else EDGE_SHARE * q
    total = share.sum() if share.size else 0.0
    if total <= 0.0:
        s.lost += volume
    else:
        for i in range(r1 - r0):
            for j in range(c1 - c0):
                z[r0 + i, c0 + j] += volume * share[i, j] / (total * p.cell * p.cell)
    laid(s, volume, s.pool_x, s.pool_y)


@inner
def _take(z, solid, touched, p, s, values, height_z, temperature, time):
    """The store takes what has melted and gives the share that the path asks for."""
    path = s.carry_path
    s.store += melted(
        p, s, values, height_z, temperature, p.sections_narrowing, p.sections_narrow_path
    )
    length = p.sections_pool_length * s.width
    volume = s.store * (1.0 - math.exp(-path / length))
    if path > 0.25 * p.portion_path:
        s.pool_x, s.pool_y = s.x, s.y
        s.store -= volume
        _lay_section(z, solid, touched, p, s, volume, path, time)
        return
    s.carry_time = 0.0  # the torch stands: the path so far stays
    fullest = FULLEST * s.height * s.width * length
    if s.store > fullest:
        over = s.store - fullest
        s.store = fullest
        _lay_cap(z, solid, touched, p, s, over, time)


@inner
def _end(z, solid, touched, p, s, values, height_z, temperature, time):
    """What is left when the arc ends becomes a cap."""
    rest = s.store + s.volume
    if rest > 0.0:
        if s.width <= 0.0:
            s.width = p.width_ref
        s.store, s.volume = 0.0, 0.0
        _lay_cap(z, solid, touched, p, s, rest, time)


advance = make_advance(_take, _end)
