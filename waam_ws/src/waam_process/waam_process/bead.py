"""Mass balance of a bead: what travel speed and wire feed lay down. SI throughout.

A layer of overlapped beads takes all the metal, so its height goes with 1/speed. A single bead on a wall gets narrower
as well as lower when the torch goes faster; its exponent (about -0.3 for steel) is identified from the layers.
"""

from __future__ import annotations

from typing import Protocol, TypeAlias

import numpy as np

Value: TypeAlias = float | np.ndarray

AREA_FACTOR = 0.73  # section of a bead over width * height, eq 2.16


class BeadError(ValueError):
    """A width, speed or feed that no bead can have; the text names it."""


class Wire(Protocol):
    """What the mass balance needs to know; `materials.Material` has it."""

    @property
    def wire_area(self) -> float:
        """Cross-section of the wire, m2."""

    @property
    def efficiency(self) -> float:
        """Share of the wire that stays on the part (eta of eq 2.17), 0 to 1."""


def _positive(**values: Value) -> None:
    for name, value in values.items():
        if not np.all(np.asarray(value) > 0):  # also catches NaN
            raise BeadError(f'{name} must be above zero, not {value}')


def bead_section(width: Value, height: Value) -> np.ndarray:
    """Cross-section S = 0.73*B*H in m2 of a bead of that width and height (m), eq 2.16."""
    return AREA_FACTOR * np.asarray(width, float) * height


def bead_area(feed: Value, speed: Value, wire: Wire) -> np.ndarray:
    """Cross-section in m2 that the wire leaves behind (mass balance, eq 2.15): S =
    S_wire*V_feed*eta/V; feed, speed m/s.
    """
    _positive(speed=speed)
    return wire.wire_area * np.asarray(feed, float) * wire.efficiency / speed


def wire_feed(width: Value, height: Value, speed: Value, wire: Wire) -> np.ndarray:
    """Wire feed speed in m/s by eq 2.17: V_feed = 0.73*B*H*V/(S_wire*eta); width, height m; speed
    m/s. Inverse of `bead_area`.

    Use the programmed speed: with a corrected one this restores the very bead that the correction
    wants to change.
    """
    return bead_section(width, height) * speed / (wire.wire_area * wire.efficiency)


def layer_height(feed: Value, speed: Value, pitch: Value, wire: Wire) -> np.ndarray:
    """Height in m of a layer of overlapped beads `pitch` m apart: all the metal, spread over the
    pitch.
    """
    _positive(pitch=pitch)
    return bead_area(feed, speed, wire) / pitch


def commanded_growth(
    height: Value, feed: Value, feed_base: Value, speed: Value, speed_programmed: Value
) -> np.ndarray:
    """Growth in m that the material table expects of a corrected segment, from its final feed and
    speed (m/s).

    The plan adds `height` m with `feed_base` at `speed_programmed`; the metal per length goes with
    feed over speed. All corrections and clamps are in it, so measured growth over this one is the
    efficiency ratio of the process.
    """
    _positive(feed_base=feed_base, speed=speed, speed_programmed=speed_programmed)
    return np.asarray(height, float) * (feed / feed_base) * (speed_programmed / speed)


def deposition_rate(feed: Value, wire: Wire, density: float) -> np.ndarray:
    """Mass balance of eq 2.15 in kg/s of metal on the part; feed m/s, density kg/m3."""
    return wire.wire_area * np.asarray(feed, float) * wire.efficiency * density
