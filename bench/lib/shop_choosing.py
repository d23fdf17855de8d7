"""Twelve kinds of worn parts on which rules and constants may be chosen (seeds from 101 on). mm."""

from __future__ import annotations

import numpy as np

from .shop_shapes import HEIGHT, Worn, around, box, over, soft, waves


def pocket() -> Worn:
    """Worn pocket with feathered walls within a face."""
    plan, x, y = over(56, 40)
    r = np.hypot((x - 28) / 1.3, y - 20)
    return Worn(plan, HEIGHT + 0 * x, (2.6 + waves(x, y, 0.2, 0.3)) * soft(13.5 - r, 4.0))


def chipped_corner() -> Worn:
    """A corner broken off along a slanting face."""
    plan, x, y = over(56, 40)
    d = (30 - x - 0.8 * y) / np.hypot(1, 0.8)
    wear = np.clip(0.35 * d, 0, 6) + 0.8 * soft(d, 2.5) + waves(x, y, 0.15, 1) * soft(d, 3)
    return Worn(plan, HEIGHT + 0 * x, wear)


def worn_edge() -> Worn:
    """A long edge worn round, fading into the face."""
    plan, x, y = over(56, 40)
    wear = (3.0 + 0.6 * np.sin(x / 12)) * soft(14 - y, 13) + waves(x, y, 0.2, 2) * soft(14 - y, 4)
    return Worn(plan, HEIGHT + 0 * x, wear)


def keyway() -> Worn:
    """A keyway to be filled, its edges broken."""
    plan, x, y = over(56, 40)
    d = np.minimum(5.0 - np.abs(y - 20), np.minimum(x - 9, 47 - x))
    return Worn(plan, HEIGHT + 0 * x, 4.0 * np.clip(d + 0.5, 0, 1) + 0.8 * soft(d + 2.2, 2.2))


def pad_on_slope() -> Worn:
    """A raised pad on a face that slopes by ten degrees; its top is worn."""
    plan, x, y = over(56, 40)
    pad = (np.abs(x - 28) <= 15) & (np.abs(y - 20) <= 11)
    nominal = 8 + np.tan(np.radians(10)) * x + 6.0 * pad
    return Worn(plan, nominal, np.where(pad, 2.4 + 0.03 * (x - 28) + waves(x, y, 0.25, 3), 0))


def tooth_flank() -> Worn:
    """The flank of a coarse tooth, lying up: curved across, worn most at the tip, with a root."""
    plan, x, y = over(56, 40)
    nominal = HEIGHT - (y - 30) ** 2 / 95 * (y < 30) + 4.0 * soft(y - 34, 4)
    wear = (1.6 + 0.06 * (24 - y)) * soft(27 - y, 6) + waves(x, y, 0.15, 4) * soft(26 - y, 4)
    return Worn(plan, nominal, wear)


def boss() -> Worn:
    """A boss with a bore on a plate, its face worn and tilted."""
    plan, x, y = over(64, 56)
    r = np.hypot(x - 32, y - 28)
    nominal = 10 + 14.0 * (r <= 19.5)
    wear = np.where(r <= 19.5, 3.2 + 0.03 * (x - 32) - 0.02 * (y - 28) + waves(x, y, 0.2, 5), 0)
    return Worn(plan, nominal, wear, r - 7)


def pits() -> Worn:
    """Four corrosion pits of 8 to 20 mm in a pump face, two of them grown together."""
    plan, x, y = over(84, 60)
    places = ((18, 18, 9, 3.6), (52, 38, 10, 5.0), (63, 31, 7, 3.0), (28, 46, 4.2, 2.2))
    wear = [
        depth * soft(size * (1 + 0.12 * np.sin(3 * np.arctan2(y - b, x - a) + a)) - np.hypot(x - a, y - b), 0.55 * size)
        for a, b, size, depth in places
    ]  # fmt: skip
    return Worn(plan, HEIGHT + 0 * x, np.max(wear, axis=0) * (1 + waves(x, y, 0.04, 6)))


def die_edge() -> Worn:
    """A cutting edge that winds: a band of 10 mm along it worn, its rim rounded off."""
    plan, x, y = over(90, 44)
    d = (y - 9 - 5 * np.sin(x / 13)) / np.sqrt(1 + (5 / 13 * np.cos(x / 13)) ** 2)
    wear = (2.2 + 0.5 * np.sin(x / 20 + 1) + waves(x, y, 0.15, 7)) * soft(10.5 - d, 5)
    return Worn(plan, 22 + 0 * x, wear + 1.0 * soft(3 - d, 3), d)


def base_wall() -> Worn:
    """A wall of 9 mm on a base, its top worn unevenly."""
    plan, x, y = over(70, 30)
    wall = box(x, y, (35, 15), (31, 4.5), 2) > 0
    return Worn(plan, 8 + 14.0 * wall, np.where(wall, 3.0 + 0.02 * x + waves(x, y, 0.25, 8), 0))


def cup_rim() -> Worn:
    """The rim of a cup, 10 mm wide, worn on one side."""
    plan, r, a = around(19, 29)
    return Worn(plan, 20 + 0 * r, 2.8 + 0.9 * np.cos(a - 0.8) + 0.2 * np.sin(4 * a))


def cam() -> Worn:
    """A cam lying flat: its face is chipped around the nose and worn along the outline."""
    plan, r, a = around(
        6, lambda a: 18 + 12 * np.exp(-((np.angle(np.exp(1j * (a - 1))) / 0.7) ** 2))
    )
    edge = r.max(axis=0) - r
    nose = np.exp(-((np.angle(np.exp(1j * (a - 1))) / 0.9) ** 2))
    wear = (1.6 + 2.2 * nose + 0.2 * np.sin(5 * a)) * soft(12 - edge, 8)
    return Worn(plan, 18 + 0 * r, wear)


KINDS = {
    f.__name__: f
    for f in (
        pocket, chipped_corner, worn_edge, keyway, pad_on_slope, tooth_flank, boss, pits, die_edge, base_wall, cup_rim,
        cam,
    )
}  # fmt: skip
