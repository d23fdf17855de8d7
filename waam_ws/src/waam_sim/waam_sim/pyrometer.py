"""A long-wave pyrometer on the table, aimed at one spot of the part: lag, noise, emissivity error, stuck reading."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_node.params import param

from .compiled import normal

C2 = 1.438777e-2
KELVIN = 273.15


@dataclass(frozen=True)
class PyrometerParams:
    """Pyrometer. It looks at the centre of the part and can be aimed, unless its spot is given."""

    spot_x: float = param(
        math.nan,
        'of the measuring spot, work frame; NaN = centre of the part, follows pyrometer_aim',
        'm',
    )
    spot_y: float = param(
        math.nan,
        'of the measuring spot, work frame; NaN = centre of the part, follows pyrometer_aim',
        'm',
    )
    rate: float = 10.0  # readings per second [1/s]
    lag: float = 0.25  # time constant [s]
    noise: float = 0.8  # sigma of a reading [K]
    resolution: float = 0.1  # of a reading [K]
    emissivity: float = param(0.82, 'of the surface', '', 0.05, 1.0)
    emissivity_set: float = 0.85  # that the instrument assumes
    wavelength: float = 10e-6  # effective wavelength [m]
    range_low: float = 0.0  # lowest reading [degC]
    range_high: float = 1000.0  # highest reading [degC]


def apparent(true_c: float, p: PyrometerParams) -> float:
    """What the instrument reads at a true temperature (degrees Celsius): Wien, 1/Tm = 1/T - lambda/c2 ln(e/e_set)."""
    inverse = 1.0 / (true_c + KELVIN)
    inverse -= p.wavelength / C2 * math.log(p.emissivity / p.emissivity_set)
    return 1.0 / inverse - KELVIN


@dataclass
class Pyrometer:
    """The instrument's memory: the lagged temperature and the last reading (degrees Celsius)."""

    params: PyrometerParams
    rng: np.ndarray
    lagged: float = math.nan
    reading: float = math.nan

    def read(self, true_c: float, dt: float, stuck: bool = False) -> float:
        """The reading `dt` seconds after the one before."""
        p = self.params
        seen = apparent(true_c, p)
        if math.isnan(self.lagged):
            self.lagged = seen
        self.lagged += (seen - self.lagged) * (dt / (p.lag + dt))
        if stuck and not math.isnan(self.reading):
            return self.reading
        noisy = self.lagged + p.noise * normal(self.rng)
        limited = min(max(noisy, p.range_low), p.range_high)
        self.reading = round(limited / p.resolution) * p.resolution
        return self.reading
