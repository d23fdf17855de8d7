"""What the burning arc does to the profiles of the scanner beside it: glare, spatter, smoke, lost profiles.

Its light makes the camera see points that are not there, or none; drops of metal fly through the fan of light; smoke
swallows points. Glare and smoke last, so neighbouring profiles are spoilt alike. How often and how large it is is taken
from the recorded profiles beside an arc (docs/recordings.md): some 7 % of their points are off by 1.5 to 9 mm, in
clusters of 1 to 20 points. Lengths in m. It has random numbers of its own: without an arc nothing is drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waam_node.params import param


@dataclass(frozen=True)
class ArclightParams:
    """Spoilt profiles beside the arc."""

    glare: float = param(0.15, 'share of the time with glare in the profiles', '', 0.0, 0.95)
    glare_time: float = param(0.05, 'mean time that it lasts', 's', 1e-3, 10.0)
    glare_width: float = param(4e-3, 'mean width of it across the profile', 'm', 1e-4, 0.05)
    glare_lost: float = param(
        0.5, 'share of its points that are lost; the others are off', '', 0.0, 1.0
    )
    glare_size: float = param(4e-3, 'mean error of the others', 'm', 0.0, 0.05)
    spatter: float = param(5.0, 'drops in a profile, mean', '', 0.0, 100.0)
    spatter_points: float = param(8.0, 'points of a drop, mean', '', 1.0, 100.0)
    spatter_size: float = param(5e-3, 'mean height of a drop above the surface', 'm', 0.0, 0.05)
    smoke: float = param(0.2, 'share of the time with smoke', '', 0.0, 0.95)
    smoke_time: float = param(0.3, 'mean time that it lasts', 's', 1e-3, 10.0)
    smoke_dropout: float = param(0.4, 'share of the points that it swallows', '', 0.0, 1.0)
    lost: float = param(0.02, 'share of the profiles that are lost altogether', '', 0.0, 1.0)


@dataclass
class Arclight:
    """Parameters, random numbers and what lasts: glare (lateral coordinate, half width, error; m) and smoke."""

    params: ArclightParams
    rng: np.random.Generator
    glare: tuple[float, float, float] | None = None
    smoke: bool = False
    _last_us: int = field(default=-1)

    @classmethod
    def of(cls, params: ArclightParams, seed: int) -> Arclight:
        """The same seed gives the same light."""
        return cls(params, np.random.default_rng([seed & 0xFFFFFFFF, 23]))

    def spoil(
        self, times: np.ndarray, lateral: np.ndarray, z: np.ndarray, intensity: np.ndarray
    ) -> None:
        """Changes profiles z, intensity (n, points), exposed at times (n,) us; lateral (points,): m of every point."""
        for t, heights, light in zip(times.tolist(), z, intensity, strict=True):
            dt = (t - self._last_us) * 1e-6 if 0 <= self._last_us < t else math.inf
            self._last_us = t
            self._change(dt, lateral)
            self._profile(lateral, heights, light)

    def _turned(self, on: bool, dt: float, share: float, lasting: float) -> bool:
        """A state that is on for `share` of the time and for `lasting` s on average, `dt` s later."""
        memory = math.exp(-dt / (lasting * (1.0 - share)))
        return bool(self.rng.random() < share + memory * (on - share))

    def _change(self, dt: float, lateral: np.ndarray) -> None:
        p, rng = self.params, self.rng
        self.smoke = self._turned(self.smoke, dt, p.smoke, p.smoke_time)
        if not self._turned(self.glare is not None, dt, p.glare, p.glare_time):
            self.glare = None
        elif self.glare is None:
            error = rng.exponential(p.glare_size) * rng.choice((-1.0, 1.0))
            half = 0.5 * rng.exponential(p.glare_width)
            self.glare = float(rng.choice(lateral)), half, float(error)

    def _profile(self, lateral: np.ndarray, z: np.ndarray, light: np.ndarray) -> None:
        p, rng = self.params, self.rng
        if rng.random() < p.lost:
            z[:] = np.nan
            return
        if self.glare is not None:
            middle, half, error = self.glare
            under = np.abs(lateral - middle) <= half
            gone = rng.random(len(z)) < p.glare_lost
            z[under & gone] = np.nan
            z[under] += np.float32(error * (1.0 + 0.1 * rng.standard_normal()))
            light[under] = 1.0
        for _ in range(rng.poisson(p.spatter)):
            first, count = rng.integers(len(z)), rng.geometric(1.0 / p.spatter_points)
            z[first : first + count] += np.float32(rng.exponential(p.spatter_size))
            light[first : first + count] = 1.0
        if self.smoke:
            z[rng.random(len(z)) < p.smoke_dropout] = np.nan
            light *= np.float32(1.0 - p.smoke_dropout)
