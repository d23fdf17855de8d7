"""Geometry and mass balance of a bead: what current, voltage, speed and wire feed lay down. SI
throughout.

Two uses, two shapes of law: a single bead on a wall gets narrower as well as lower when the torch
goes faster (power laws with exponents of about -0.3 for steel); a layer of overlapped beads takes
all the metal, so its height follows the mass balance (exponent -1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

AREA_FACTOR = 0.73  # S_bead = 0.73*B*H, source of eq 2.17
KB = 1.25  # eq 2.13; printed as 12.5 in the source, see `lebedev_width`
KH = 0.85  # eq 2.14
TANGENT_OVERLAP = 0.738  # pitch over width, tangent overlapping model
FLAT_TOP_OVERLAP = 2 / 3  # pitch over width at which parabolic beads merge to their own height


class BeadError(ValueError):
    """A width, speed or feed that no bead can have; the text names it."""


class Wire(Protocol):
    """What the mass balance needs to know; `materials.Material` has it."""

    @property
    def wire_area(self) -> float: ...
    @property
    def efficiency(self) -> float: ...


@dataclass(frozen=True)
class BeadLaw:
    """Height of a single bead at one wire feed (m/s): ln(height in mm) = a*ln(speed in mm/s) +
    b.
    """

    feed: float
    a: float
    b: float

    def __post_init__(self) -> None:
        if not (self.feed > 0 and np.isfinite([self.a, self.b]).all() and self.a < 0):
            raise BeadError(
                f'bead law at feed {self.feed} m/s: a = {self.a} must be below zero, '
                f'b = {self.b} finite'
            )


def _positive(**values: float | np.ndarray) -> None:
    for name, value in values.items():
        if not np.all(np.asarray(value) > 0):  # also catches NaN
            raise BeadError(f'{name} must be above zero, not {value}')


def lebedev_width(current, voltage, speed):
    """Bead width in m by eq 2.13: B = Kb*I^0.35*U^0.4/V^0.5 (B mm, I A, V m/h; 1.2 mm steel wire in
    Ar + CO2).

    current A, voltage V, speed m/s. The source prints Kb = 12.5. With I = 180 A, U = 22 V, V = 20
    m/h that is a bead 59 mm wide of 138 mm2, where the wire delivers about 15.8 mm2; Kb = 1.25
    gives 5.9 mm and 13.9 mm2 and is used here.
    """
    _positive(current=current, voltage=voltage, speed=speed)
    v = np.asarray(speed, float) * 3600
    return 1e-3 * KB * np.power(current, 0.35) * np.power(voltage, 0.4) / np.sqrt(v)


def lebedev_height(current, voltage, speed):
    """Bead height in m by eq 2.14: H = Kh*I^0.6*U^0.1/V^0.7 (H mm, V m/h). current A, voltage V,
    speed m/s.
    """
    _positive(current=current, voltage=voltage, speed=speed)
    v = np.asarray(speed, float) * 3600
    return 1e-3 * KH * np.power(current, 0.6) * np.power(voltage, 0.1) / np.power(v, 0.7)


def single_bead_height(laws: Sequence[BeadLaw], feed, speed):
    """Height in m of a single bead from the published log-log fits; feed, speed in m/s.

    Between two wire feeds ln(height) is interpolated linearly in the feed; outside the table its
    nearest row is used.
    """
    if not laws:
        raise BeadError('this material has no single-bead law')
    _positive(feed=feed, speed=speed)
    feeds = np.array([law.feed for law in laws])
    a = np.interp(feed, feeds, [law.a for law in laws])
    b = np.interp(feed, feeds, [law.b for law in laws])
    return 1e-3 * np.exp(a * np.log(np.asarray(speed, float) * 1e3) + b)


def bead_section(width, height):
    """Cross-section S = 0.73*B*H in m2 of a bead of that width and height (m)."""
    return AREA_FACTOR * np.asarray(width, float) * height


def bead_area(feed, speed, wire: Wire):
    """Cross-section in m2 that the wire leaves behind (mass balance, eq 2.15): S =
    S_wire*V_feed*eta/V; feed, speed m/s.
    """
    _positive(speed=speed)
    return wire.wire_area * np.asarray(feed, float) * wire.efficiency / speed


def wire_feed(width, height, speed, wire: Wire):
    """Wire feed speed in m/s by eq 2.17: V_feed = 0.73*B*H*V/(S_wire*eta); width, height m; speed
    m/s. Inverse of `bead_area`.

    Use the programmed speed: with a corrected one this restores the very bead that the correction
    wants to change.
    """
    return bead_section(width, height) * speed / (wire.wire_area * wire.efficiency)


def layer_height(feed, speed, pitch, wire: Wire):
    """Height in m of a layer of overlapped beads `pitch` m apart: all the metal, spread over the
    pitch.
    """
    _positive(pitch=pitch)
    return bead_area(feed, speed, wire) / pitch


def commanded_growth(height, feed, feed_base, speed, speed_programmed):
    """Growth in m that the material table expects of a corrected segment, from its final feed and
    speed (m/s).

    The plan adds `height` m with `feed_base` at `speed_programmed`; the metal per length goes with
    feed over speed. All corrections and clamps are in it, so measured growth over this one is the
    efficiency ratio of the process.
    """
    _positive(feed_base=feed_base, speed=speed, speed_programmed=speed_programmed)
    return np.asarray(height, float) * (feed / feed_base) * (speed_programmed / speed)


def deposition_rate(feed, wire: Wire, density: float):
    """kg/s of metal on the part; feed m/s, density kg/m3."""
    return wire.wire_area * np.asarray(feed, float) * wire.efficiency * density


def pitch_for(width, model: str = 'plan'):
    """Distance of neighbouring beads in m: 'plan' (0.73, keeps pitch*H = S of eq 2.17), 'tangent'
    (0.738) or 'flat_top' (2/3).
    """
    ratios = {'plan': AREA_FACTOR, 'tangent': TANGENT_OVERLAP, 'flat_top': FLAT_TOP_OVERLAP}
    if model not in ratios:
        raise BeadError(f"unknown overlap model '{model}'; known are {', '.join(ratios)}")
    return ratios[model] * np.asarray(width, float)
