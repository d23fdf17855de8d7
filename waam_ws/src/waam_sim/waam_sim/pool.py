"""What the metal models share: how melt is gathered, where the torch heads, what scatters.

Widths and the balance of the wire are the same (`bead_width`, `transfer`): the models differ in where the metal goes,
not in how much of it there is. Lengths in m, times in s, temperatures in degrees Celsius.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from .arc import REFERENCE_CTWD
from .compiled import bilinear, inner, jit
from .disturbance import AREA_FIXED, AREA_LAYER, WIDTH, noise

MIN_WIDTH, MAX_WIDTH = 2.5e-3, 14e-3
MIN_SPEED = 2e-3
REFERENCE_TEMPERATURE = 150.0
ARC_REACH = 10e-3  # m below the highest place under it that the arc still burns to
# m beside the wire that an arc can strike to where there is nothing below the wire
STRIKE_REACH = 1.5e-3
POOL_TIME = 0.1  # s, in which the pool's size follows power and travel speed
# m that the torch has to leave behind to have a direction: a stop, with the last steps of single motors, has none
HEADING_PATH = 5e-5
TURN_PATH = 1e-3  # m on which the pool takes the direction of the torch
RESOLIDIFIED_AFTER = 0.5  # s without new melt


@jit
def bead_width(p, power, speed, temperature):
    """Width of a single bead, m: a power law of the simulation's own, wider on hot metal."""
    v = max(speed, MIN_SPEED)
    hot = 1.0 + p.hot_width_per_k * (temperature - REFERENCE_TEMPERATURE)
    w = p.width_ref * (max(power, 100.0) / p.power_ref) ** p.power_exponent
    w *= (v / p.speed_ref) ** -p.speed_exponent * hot
    return min(max(w, MIN_WIDTH), MAX_WIDTH)


@jit
def transfer(p, ctwd, temperature, gas):
    """Share of the wire that becomes bead, 0..1."""
    share = p.transfer * (1.0 - p.spatter_per_m * max(ctwd - REFERENCE_CTWD, 0.0))
    share *= 1.0 - p.hot_loss_per_k * (temperature - REFERENCE_TEMPERATURE)
    if not gas:
        share *= 1.0 - p.no_gas_loss
    return min(max(share, 0.0), 1.0)


@jit
def box(shape, p, s, x, y, radius):
    """Rows and columns (first, past the last) of the circle plus one cell, inside the field."""
    a = p.cell
    c0 = max(int(math.floor((x - radius - s.origin_x) / a)) - 1, 0)
    c1 = min(int(math.floor((x + radius - s.origin_x) / a)) + 2, shape[1])
    r0 = max(int(math.floor((y - radius - s.origin_y) / a)) - 1, 0)
    r1 = min(int(math.floor((y + radius - s.origin_y) / a)) + 2, shape[0])
    return r0, max(r1, r0), c0, max(c1, c0)


@inner
def under_wire(z, p, s, x, y):
    """Level that the wire meets; over a notch or beside an edge that of the metal next to it: the arc jumps there."""
    level = bilinear(z, s.origin_x, s.origin_y, p.cell, x, y, 0.0)
    r0, r1, c0, c1 = box(z.shape, p, s, x, y, STRIKE_REACH)
    highest = level
    for r in range(r0, r1):
        for c in range(c0, c1):
            dx = s.origin_x + (c + 0.5) * p.cell - x
            dy = s.origin_y + (r + 0.5) * p.cell - y
            if dx * dx + dy * dy <= STRIKE_REACH * STRIKE_REACH:
                highest = max(highest, z[r, c])
    return level if level >= highest - ARC_REACH else highest


@inner
def follow_speed(s, x, y, dt):
    """The torch's step to (x, y) in m; its speed comes into the state as the pool feels it."""
    step = math.hypot(x - s.x, y - s.y)
    s.x, s.y = x, y
    s.speed += (step / dt - s.speed) * min(dt / POOL_TIME, 1.0)
    return step


@inner
def strike(z, p, s, x, y):
    """An arc begins at (x, y)."""
    s.active, s.path, s.volume, s.carry_path, s.carry_time = 1.0, 0.0, 0.0, 0.0, 0.0
    s.pool_x, s.pool_y, s.head_x, s.head_y = x, y, 0.0, 0.0
    s.from_x, s.from_y, s.dir_x, s.dir_y, s.store = x, y, 0.0, 0.0, 0.0
    s.surface = under_wire(z, p, s, x, y)
    s.power = p.power_ref


@inner
def gather(p, s, x, y, step, dt, wire_speed, power, temperature, ctwd, gas):
    """Adds the wire of one sample to what is molten, and turns the pool with the torch. Returns whether there is enough
    for a portion."""
    gone_x, gone_y = x - s.from_x, y - s.from_y
    gone = math.hypot(gone_x, gone_y)
    if gone >= HEADING_PATH:
        s.head_x, s.head_y = gone_x / gone, gone_y / gone
        s.from_x, s.from_y = x, y
        share = 1.0 if s.dir_x == 0.0 and s.dir_y == 0.0 else min(gone / TURN_PATH, 1.0)
        s.dir_x += share * (s.head_x - s.dir_x)
        s.dir_y += share * (s.head_y - s.dir_y)
    s.power += (power - s.power) * min(dt / POOL_TIME, 1.0)
    s.path += step
    s.carry_path += step
    s.carry_time += dt
    section = 0.25 * math.pi * p.wire_diameter * p.wire_diameter
    s.volume += section * wire_speed * dt * transfer(p, ctwd, temperature, gas)
    return s.carry_path >= p.portion_path or s.carry_time >= p.portion_time


@inner
def melted(p, s, values, height_z, temperature, narrowing, narrow_path):
    """Volume (m^3) of the portion that is due, with its scatter; width and height of the bead come into the state."""
    u, v = s.pool_x / p.noise_length, s.pool_y / p.noise_length
    w = height_z / p.noise_height
    area = 1.0 + p.area_noise_fixed * noise(values, AREA_FIXED, u, v, 0.0)
    area += p.area_noise_layer * noise(values, AREA_LAYER, u, v, w)
    width = bead_width(p, s.power, s.speed, temperature)
    width *= 1.0 + p.width_noise * noise(values, WIDTH, u, v, w)
    if p.width_follows > 0.0:
        width *= max(area, 0.2) ** p.width_follows
    width *= 1.0 - narrowing * math.exp(-s.path / narrow_path)
    s.width = max(width, MIN_WIDTH)
    volume = s.volume * max(area, 0.2)
    rate = volume / max(s.carry_path, MIN_SPEED * s.carry_time)
    s.height = min(max(1.5 * rate / s.width, 2e-4), 0.7 * s.width)
    s.volume = 0.0
    return volume


@inner
def laid(s, volume, x, y):
    """Notes that a portion was laid at (x, y)."""
    s.deposited += volume
    s.portion, s.portion_x, s.portion_y = s.portion + volume, x, y
    s.carry_path, s.carry_time = 0.0, 0.0


@inner
def touch(z, solid, touched, p, s, x, y, radius, depth, time):
    """The pool reaches a circle: where it was solid before, `depth` m of it melt again. Returns the box of its cells,
    (first, past the last) row and column, inside the field."""
    r0, r1, c0, c1 = box(z.shape, p, s, x, y, radius)
    for r in range(r0, r1):
        dy = s.origin_y + (r + 0.5) * p.cell - y
        for c in range(c0, c1):
            dx = s.origin_x + (c + 0.5) * p.cell - x
            if dx * dx + dy * dy <= radius * radius:
                if abs(time - touched[r, c]) > RESOLIDIFIED_AFTER:
                    solid[r, c] = z[r, c] - depth
                touched[r, c] = time
    return r0, r1, c0, c1


@inner
def splat(z, p, s, x, y, volume):
    """Adds volume (m^3) at a point, shared among the four nearest cells. Returns what fell outside of the field."""
    u = (x - s.origin_x) / p.cell - 0.5
    v = (y - s.origin_y) / p.cell - 0.5
    c, r = int(math.floor(u)), int(math.floor(v))
    outside = 0.0
    for i in range(2):
        for j in range(2):
            part = volume * (v - r if i else 1.0 - v + r) * (u - c if j else 1.0 - u + c)
            m, n = r + i, c + j
            if m >= 0 and n >= 0 and m < z.shape[0] and n < z.shape[1]:
                z[m, n] += part / (p.cell * p.cell)
            else:
                outside += part
    return outside


@inner
def stay(p, s, x, y, step, dt):
    """A model that sets the pool itself."""


def make_advance(take: Callable, end: Callable, follow: Callable = stay) -> Callable:
    """`advance` of a model from its compiled steps: take lays the portion that is due, end is called once when the arc
    goes out, both (z, solid, touched, p, s, values, height_z, temperature, time); follow (p, s, x, y, step, dt) moves
    the pool after the arc.

    advance lives through one sample of `dt`: the arc at (x, y), torch at height_z (m, work frame), real wire speed in
    m/s, power in W.
    """

    @inner
    def advance(
        z, solid, touched, p, s, values, time, dt, x, y, height_z, lit, wire_speed, power, temperature, ctwd, gas,
    ):  # fmt: skip
        step = follow_speed(s, x, y, dt)
        if not lit:
            if s.active > 0.0:
                end(
                    z, solid, touched, p, s, values, height_z=height_z, temperature=temperature, time=time,
                )  # fmt: skip
                s.active = 0.0
            return
        if s.active == 0.0:
            strike(z, p, s, x, y)
        due = gather(
            p, s, x, y, step=step, dt=dt, wire_speed=wire_speed, power=power, temperature=temperature, ctwd=ctwd,
            gas=gas,
        )  # fmt: skip
        follow(p, s, x, y, step, dt)
        if due:
            take(
                z, solid, touched, p, s, values, height_z=height_z, temperature=temperature, time=time,
            )  # fmt: skip

    return advance
