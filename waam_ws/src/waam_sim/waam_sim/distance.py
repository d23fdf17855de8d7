"""Distance sensor at the torch: a triangulation laser or the infrared sensor of source 001. Lengths m, times s.

It looks down ahead of the arc, on a mount that turns with the path; before the first motion it looks under the wire.
Its answer is the mean of a small spot. It is blind beyond its range and where the spot lies over an edge, and the arc's
glare takes readings away, the more the nearer the spot is to it. The infrared sensor answers with the voltage of an
ideal triangulation, U = 0.13 V m / L, through a 10-bit converter of 5 V; the controller's polynomial is another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waam_node.params import param

from .compiled import SOURCES, Settled, bilinear, jit, normal, record, uniform
from .placement import METAL, rise

INFRARED_VM = 0.13  # V m
FULL_SCALE, COUNTS = 5.0, 1023.0


@dataclass(frozen=True)
class DistanceParams:
    """Distance sensor at the torch."""

    kind: str = param('laser', 'what is fitted to the torch', choices=('none', 'laser', 'infrared'))
    height: float = 0.1  # reading where the contact distance is 15 mm [m]
    lead: float = 0.008  # from the wire to the spot, along the path [m]
    spot: float = 1.0e-3  # radius of the spot [m]
    # difference of height within the spot from which on there is no reading [m]
    edge: float = 3.0e-3
    cycle: float = 0.002  # between two readings of the laser [s]
    noise: float = 1.0e-5  # sigma of a reading of the laser [m]
    resolution: float = 1.0e-5  # of the laser [m]
    span: float = 0.025  # of the laser to either side of `height` [m]
    infrared_cycle: float = 0.0165  # between two readings of the infrared sensor [s]
    infrared_noise: float = 2.0  # sigma of its converter in counts
    infrared_near: float = 0.035  # its nearest distance [m]
    infrared_far: float = 0.4  # its farthest distance [m]
    dropout: float = param(0.01, 'share of readings without echo', '', 0.0, 1.0)
    glare: float = 0.9  # share that the arc takes away where the spot is under it
    glare_reach: float = 0.006  # distance from the arc at which that has fallen to a third [m]


@dataclass
class Distance:
    """The sensor. `reading` counts up with every one; `value`: mm, or counts of the infrared sensor, NaN = no echo."""

    params: DistanceParams
    rng: np.ndarray
    reading: int = 0
    value: float = math.nan
    heading: tuple[float, float] = (0.0, 0.0)
    _due: float = 0.0
    _drift: float = 0.0

    def __post_init__(self) -> None:
        self._record = record(self.params)
        self._spot_distance = Settled(spot_distance)

    @property
    def cycle(self) -> float:
        """Time between two readings of this kind of sensor, s."""
        infrared = self.params.kind == 'infrared'
        return self.params.infrared_cycle if infrared else self.params.cycle

    def turn(self, dx: float, dy: float) -> None:
        """The torch has moved by so much (m): the mount turns that way."""
        way = math.hypot(dx, dy)
        if way > 2e-5:
            self.heading = (dx / way, dy / way)

    def spot(self, x: float, y: float) -> tuple[float, float]:
        """Where it looks with the wire at (x, y), m."""
        lead = self.params.lead
        return x + lead * self.heading[0], y + lead * self.heading[1]

    def pass_time(self, dt: float) -> int:
        """Readings that came in `dt` s."""
        if self.params.kind == 'none':
            return 0
        count, cycle = 0, self.cycle
        self._due -= dt
        while self._due <= 1e-9:
            self._due += cycle
            count += 1
        return count

    def measure(
        self, surface: Surface, tip: np.ndarray, lit: bool, wrong: Wrong, count: int, dt: float
    ) -> None:
        """Takes the newest of `count` readings with the torch at `tip` (m, work frame) and the arc `lit`."""
        self._drift += wrong.drift * dt
        if count == 0 or wrong.dead:
            return
        self.reading += count
        if wrong.stuck:
            return
        tip_x, tip_y, height = tip.tolist()
        x, y = self.spot(tip_x, tip_y)
        z, *grid, hot, kept, lp, ls = surface
        arrays = (z, hot, kept, lp, ls, self._record, self.rng)
        far = self._spot_distance(arrays, *grid, x, y, height, lit, wrong.dropout)
        if wrong.inverted:
            far = 2.0 * self.params.height - far
        said = self._answer(far + self._drift) * wrong.unit
        self.value = math.nan if math.isnan(said) else said

    def _answer(self, far: float) -> float:
        """What the instrument says of a distance (m)."""
        p = self.params
        if p.kind == 'infrared':
            if not p.infrared_near <= far <= p.infrared_far:
                return math.nan
            counts = INFRARED_VM / far / FULL_SCALE * COUNTS + p.infrared_noise * normal(self.rng)
            return float(round(min(max(counts, 0.0), COUNTS)))
        if not abs(far - p.height) <= p.span:
            return math.nan
        return round((far + p.noise * normal(self.rng)) / p.resolution) * p.resolution * 1e3


@dataclass(frozen=True)
class Wrong:
    """Faults of the sensor. drift: m/s; unit: factor of what it says; dropout: share of readings without echo."""

    dead: bool = False
    stuck: bool = False
    inverted: bool = False
    drift: float = 0.0
    unit: float = 1.0
    dropout: float = 0.0


NOTHING_WRONG = Wrong()

# z (rows, cols), its origin x and y, its cell, and hot, kept, parameters and state of the part's placement
Surface = tuple[np.ndarray, float, float, float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _make_spot(sources: int) -> Callable:
    @jit
    def spot_distance(
        z, hot, kept, lp, ls, dp, rng, origin_x, origin_y, cell, x, y, height, lit, dropout
    ):
        """Distance from the sensor to the metal under its spot, m; NaN = no echo."""
        p = dp[0]
        if not sources:
            return np.nan
        total, low, high = 0.0, 1e9, -1e9
        for i in range(9):
            turn = 0.25 * math.pi * i
            out = 0.0 if i == 8 else p.spot
            px, py = x + out * math.cos(turn), y + out * math.sin(turn)
            h = bilinear(z, origin_x, origin_y, cell, px, py, 0.0)
            if h > METAL:
                h += rise(hot, kept, lp[0], ls[0], px, py)
            total += h
            low, high = min(low, h), max(high, h)
        lost = p.dropout + dropout
        if lit:
            lost += p.glare * math.exp(-((p.lead / p.glare_reach) ** 2))
        if high - low > p.edge or uniform(rng) < lost:
            return np.nan
        return p.height + height - total / 9.0

    return spot_distance


spot_distance = _make_spot(SOURCES)
