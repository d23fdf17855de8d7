"""What the metal models other than `metal` share: how melt is gathered, where the torch heads, what scatters.

Widths and the balance of the wire are those of `metal` (`bead_width`, `transfer`): the models differ in where the metal
goes, not in how much of it there is. Lengths in m, times in s, temperatures in degrees Celsius.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from .compiled import inner
from .disturbance import AREA_FIXED, AREA_LAYER, WIDTH, noise
from .metal import MIN_SPEED, MIN_WIDTH, POOL_TIME, bead_width, transfer, under_wire

HEADING_PATH = 5e-5  # m that the torch has to leave behind to have a direction
TURN_PATH = 1e-3  # m on which the pool takes the direction of the torch
RESOLIDIFIED_AFTER = 0.5  # s without new melt


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
    a = p.cell
    rows, cols = z.shape
    c0 = max(int(math.floor((x - radius - s.origin_x) / a)) - 1, 0)
    c1 = max(min(int(math.floor((x + radius - s.origin_x) / a)) + 2, cols), c0)
    r0 = max(int(math.floor((y - radius - s.origin_y) / a)) - 1, 0)
    r1 = max(min(int(math.floor((y + radius - s.origin_y) / a)) + 2, rows), r0)
    for r in range(r0, r1):
        dy = s.origin_y + (r + 0.5) * a - y
        for c in range(c0, c1):
            dx = s.origin_x + (c + 0.5) * a - x
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


def make_advance(take: Callable, end: Callable) -> Callable:
    """`advance` of a model, as of `metal.advance`, from its two compiled steps: take lays the portion that is due, end
    is called once when the arc goes out. Both: (z, solid, touched, p, s, values, height_z, temperature, time)."""

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
        if gather(
            p, s, x, y, step=step, dt=dt, wire_speed=wire_speed, power=power, temperature=temperature, ctwd=ctwd,
            gas=gas,
        ):  # fmt: skip
            take(
                z,
                solid,
                touched,
                p,
                s,
                values,
                height_z=height_z,
                temperature=temperature,
                time=time,
            )

    return advance
