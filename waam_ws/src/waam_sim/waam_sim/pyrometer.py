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


def apparent(true_c: float, p: PyrometerParams, ambient_c: float, dial: float = 1.0) -> float:
    """What the instrument reads at a true temperature (degrees Celsius). dial: factor on the emissivity that it was
    delivered with, by a person at the instrument. The surface reflects the surroundings, which
    the instrument takes off as it believes in its emissivity: L(Tm) = L(Ta) + e/e_set (L(T) - L(Ta)), with Wien's
    radiance L(T) = exp(-c2 / (lambda T)). A part as cold as its surroundings reads right whatever its emissivity."""
    around, from_part = (math.exp(-C2 / (p.wavelength * (c + KELVIN))) for c in (ambient_c, true_c))
    seen = around + p.emissivity / (dial * p.emissivity_set) * (from_part - around)
    return -C2 / (p.wavelength * math.log(max(seen, 1e-9))) - KELVIN


@dataclass
class Pyrometer:
    """The instrument's memory: the lagged temperature and the last reading (degrees Celsius)."""

    params: PyrometerParams
    rng: np.ndarray
    ambient: float  # of the surroundings, degrees Celsius
    lagged: float = math.nan
    reading: float = math.nan

    def read(self, true_c: float, dt: float, stuck: bool = False, dial: float = 1.0) -> float:
        """The reading `dt` seconds after the one before."""
        p = self.params
        seen = apparent(true_c, p, self.ambient, dial)
        if math.isnan(self.lagged):
            self.lagged = seen
        self.lagged += (seen - self.lagged) * (dt / (p.lag + dt))
        if stuck and not math.isnan(self.reading):
            return self.reading
        noisy = self.lagged + p.noise * normal(self.rng)
        limited = min(max(noisy, p.range_low), p.range_high)
        self.reading = round(limited / p.resolution) * p.resolution
        return self.reading
