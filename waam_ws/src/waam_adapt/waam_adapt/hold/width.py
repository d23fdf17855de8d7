"""Bead width held by the voltage of the source, from bead to bead.

B ~ U^0.4 (eq 2.13 of source 000; the exponent of the voltage alone is used, so its misprinted constant does not
matter). Speed and wire stay with the height (docs/interfaces.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

EXPONENT = 0.4  # d ln(width) / d ln(voltage)


@dataclass(frozen=True)
class WidthSettings:
    """SI."""

    width: float  # m, wanted
    voltage: float  # V, to begin with
    low: float  # V
    high: float  # V
    unknown: float = 0.5e-3  # m, standard uncertainty of the width that the first voltage gives
    drift: float = 0.08e-3  # m, by which that changes from bead to bead
    scatter: float = 0.10e-3  # m, of the mean widths of beads with the same voltage

    def __post_init__(self) -> None:
        if not (self.width > 0 and 0 < self.low <= self.voltage <= self.high):
            raise ValueError(
                f'width is {self.width:g} m, voltage {self.voltage:g} V, limits {self.low:g} .. {self.high:g} V: '
                'the width must be above 0 and the voltage within its limits'
            )


class WidthControl:
    """`voltage` is that of the next bead.

    How much of an error is taken away is the gain of a scalar Kalman filter: nearly all of the first one, then less,
    for beads scatter.
    """

    def __init__(self, settings: WidthSettings) -> None:
        self.settings, self.voltage = settings, settings.voltage
        self._variance = settings.unknown**2  # m2, of what the voltage makes of the width

    @property
    def limited(self) -> bool:
        """The voltage is at one of its limits."""
        return not self.settings.low < self.voltage < self.settings.high

    def add(self, width: float, u: float) -> float:
        """Mean width of the last bead (m) and its standard uncertainty; returns the voltage of the next one.

        What is no number or no width changes nothing: a bead that was not seen is not judged.
        """
        s = self.settings
        sound = math.isfinite(width) and math.isfinite(u) and width > 0 and u >= 0
        self._variance += s.drift**2
        if not sound:
            return self.voltage
        gain = self._variance / (self._variance + u**2 + s.scatter**2)
        self._variance *= 1 - gain
        step = gain * math.log(s.width / width) / EXPONENT
        self.voltage = min(max(self.voltage * math.exp(step), s.low), s.high)
        return self.voltage
