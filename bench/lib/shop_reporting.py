"""Twelve kinds of worn parts that nothing is chosen on; seeds 1 to 3. mm."""

from __future__ import annotations

import numpy as np

from .shop_shapes import HEIGHT, Worn, along, around, box, over, soft, waves


def gear_tooth() -> Worn:
    """Two teeth of a rack seen from above: lands of 14 mm broken off on one side, a gap between them."""
    plan, x, y = over(58, 36)
    tooth = np.abs(np.abs(x - 29) - 17) <= 9
    wear = (2.2 + 0.9 * np.sin(y / 9)) * soft(36 - y, 30) + 1.8 * soft(12 - y, 8)
    return Worn(plan, 8 + 12.0 * tooth, np.where(tooth, wear + waves(x, y, 0.2, 1), 0))


def hammer_face() -> Worn:
    """Face of a hammer with eight sides, slightly crowned, chipped along one of them."""
    plan, x, y = over(46, 46)
    u, v = x - 23, y - 23
    inside = 22 - np.maximum(np.maximum(abs(u), abs(v)), (abs(u) + abs(v)) / np.sqrt(2))
    wear = 2.6 + waves(x, y, 0.2, 2) + 2.4 * soft(u - 8, 12)
    return Worn(plan, 26 - (u**2 + v**2) / 240, wear, inside)


def rail_head() -> Worn:
    """Crowned head of a rail, worn most at one side, fading out at both ends."""
    plan, x, y = over(120, 60)
    nominal = 22 - (y - 30) ** 2 / 500 - 4 * np.clip(np.abs(y - 30) - 24, 0, 6) ** 2 / 36
    wear = (1.7 + 2.6 * soft(y - 32, 24) + waves(x, y, 0.15, 3)) * soft(
        np.minimum(x - 8, 112 - x), 10
    )
    return Worn(plan, nominal, wear)


def valve_seat() -> Worn:
    """Ring with a conical seat of 18 degrees on its inner side, worn more on one half."""
    plan, r, a = around(21, 30)
    nominal = 14 - np.tan(np.radians(18)) * np.clip(26 - r, 0, 5)
    return Worn(plan, nominal, 1.9 + 0.5 * np.cos(a + 1) + 0.1 * np.sin(6 * a))


def blade_tip() -> Worn:
    """A bent blade that tapers from 6 to 3.5 mm, its tip worn down."""
    plan, share, across = along(72, lambda s: 6.0 - 2.5 * s, 0.9)
    wear = 3.6 + 1.8 * share**1.5 + 0.2 * np.sin(11 * share)
    return Worn(plan, 28 + 0 * share, wear)


def slot() -> Worn:
    """A slot with round ends, 14 mm wide, in a cylindrical surface, to be closed."""
    plan, x, y = over(72, 44)
    d = box(x, y, (36, 22), (26, 7), 7)
    return Worn(plan, 20 - (y - 22) ** 2 / 220, 4.2 * soft(d + 0.6, 1.2) + 0.6 * soft(d + 3, 3))


def step() -> Worn:
    """A shoulder: the lower of two levels is worn up to the wall, and along the free side."""
    plan, x, y = over(60, 42)
    low = y < 24
    nominal = np.where(low, 13.0, 19.0)
    wear = (2.4 + 0.5 * np.sin(x / 10) + waves(x, y, 0.15, 5)) * soft(x - 6, 8)
    return Worn(plan, nominal, np.where(low, wear, 0))


def groove() -> Worn:
    """A bearing groove across a block, worn round and open at both ends."""
    plan, x, y = over(48, 44)
    nominal = 42 - np.sqrt(30.0**2 - (y - 22) ** 2)
    wear = (2.0 + waves(x, y, 0.2, 6)) * soft(15 - np.abs(y - 22), 6)
    return Worn(plan, nominal, wear)


def fork() -> Worn:
    """A fork with prongs of 11 and 15 mm, tips worn most."""
    plan, x, y = over(64, 48)
    inside = np.where((y > 11) & (y < 33) & (x > 20), -1.0, 1.0)
    wear = (1.4 + 2.6 * soft(x - 20, 40) + waves(x, y, 0.2, 7)) * soft(x - 14, 12)
    return Worn(plan, HEIGHT + 0 * x, wear, inside)


def flange() -> Worn:
    """A sealing face 17 mm wide with four holes, corroded all over and deeper in one sector."""
    plan, x, y = over(76, 76)
    u, v = x - 38, y - 38
    r = np.hypot(u, v)
    holes = np.min(
        [np.hypot(u - a, v - b) for a, b in ((28, 0), (-28, 0), (0, 28), (0, -28))], axis=0
    )
    deeper = np.exp(-((np.angle(np.exp(1j * (np.arctan2(v, u) - 0.8))) / 0.6) ** 2))
    inside = np.minimum(np.minimum(r - 19.5, 36.5 - r), holes - 4)
    return Worn(plan, 14 + 0 * r, 1.7 + 1.2 * deeper + waves(x, y, 0.2, 8), inside)


def shaft_land() -> Worn:
    """A land on a shaft, seen from above: cylindrical, worn along a third of its length, feathered all around."""
    plan, x, y = over(80, 40)
    nominal = np.sqrt(55.0**2 - (y - 20) ** 2) - 35
    wear = (
        (1.9 + waves(x, y, 0.15, 9)) * soft(20 - np.abs(x - 40), 8) * soft(17 - np.abs(y - 20), 6)
    )
    return Worn(plan, nominal, wear)


def stepped_pads() -> Worn:
    """Two small worn pads of different height on one plate, 14 x 18 and 22 x 12 mm."""
    plan, x, y = over(60, 40)
    one, two = box(x, y, (16, 20), (7, 9), 1) > 0, box(x, y, (42, 20), (11, 6), 1) > 0
    wear = np.where(one, 2.0 + waves(x, y, 0.2, 10), np.where(two, 3.4 + 0.04 * (x - 42), 0))
    return Worn(plan, 8 + 8.0 * one + 11.0 * two, wear)


KINDS = {
    f.__name__: f
    for f in (
        gear_tooth, hammer_face, rail_head, valve_seat, blade_tip, slot, step, groove, fork, flange, shaft_land,
        stepped_pads,
    )
}  # fmt: skip
