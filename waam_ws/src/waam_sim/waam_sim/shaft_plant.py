"""A shaft that turns in a chuck in place of the X axis: the cell's plane field, closed to a ring along x.

The field shows more than one turn: what lies before `first` and behind `first + period` is the same metal once more.
The torch is brought back into the first turn before the cell lives through its samples, and what it did there is copied
to the other showings of the place, so all of them stay equal, whichever metal model lays the metal. Metal at a
smaller radius than `scale` covers a smaller area, so it grows higher: volume = (z2 - z1) dx dy (core + (z1 + z2) / 2) /
scale. The pool is a circle of the field, not of the shaft: its width around the shaft is off by the ratio of radii.

What is not simulated: warp of the shaft, axes that bend, slip and backlash of the chuck, a pool that runs off the top.
Lengths in m.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec, HeightGrid
from waam_process.plant_port import SAMPLE

from .plant import Plant, PlantParams, Profiles, Reading

REACH = 18e-3  # of what the torch changes in a step: pool, crater, lumps, heat of the arc
# W/(m^2 K) from the core of the shaft to chuck and tailstock, spread over its surface: assumed, it only decides how
# long a job waits between layers
CHUCK_CONDUCTANCE = 40.0
MOVED = ('x', 'pool_x', 'from_x', 'portion_x')  # of the state of the metal


@dataclass(frozen=True)
class Chuck:
    """How the field lies around the shaft."""

    period: float  # one turn along x
    first: float  # x where the first turn begins
    scale: float  # radius at which x is as long as the surface
    core: float  # radius at z = 0
    diameter: float = 0.0  # nominal, of the shaft

    @classmethod
    def around(cls, field: GridSpec, diameter: float, level: float, heat_cell: float) -> Chuck:
        """A shaft of a nominal `diameter` whose surface stands at z = `level` of the field, which shows as much of it
        before its first turn as behind it. A turn is a whole number of cells of heat."""
        period = heat_cell * round(math.pi * diameter / heat_cell)
        x0, x1, *_ = field.extent
        first, scale = 0.5 * (x0 + x1 - period), period / (2.0 * math.pi)
        return cls(period, first, scale, 0.5 * diameter - level, diameter)

    def share(self, z: float) -> float:
        """Area on the shaft over area of the field."""
        return (self.core + z) / self.scale

    def turns(self, x: float) -> int:
        """Whole turns between x and the first turn."""
        return math.floor((x - self.first) / self.period)


class ShaftPlant(Plant):
    """The simulated cell with a shaft in its chuck. `part` shows the first turn and at least REACH at both ends."""

    def __init__(
        self, part: HeightGrid, chuck: Chuck, params: PlantParams | None = None, seed: int = 1
    ) -> None:
        """ValueError for a field that does not close, and for parts of the cell that a shaft does not have."""
        params = params or PlantParams()
        if params.gantry.on:
            raise ValueError(
                'cell.gantry_on: axes that bend are not simulated with a shaft in the chuck'
            )
        for name, cell in (('metal', params.metal.cell), ('heat', params.heat.cell)):
            if abs(chuck.period / cell - round(chuck.period / cell)) > 1e-6:
                text = f'cell.{name}_cell is {cell * 1e3:g} mm and does not divide the turn of'
                raise ValueError(f'{text} {chuck.period * 1e3:g} mm')
        x0, x1, *_ = part.spec.extent
        if x0 > chuck.first - REACH or x1 < chuck.first + chuck.period + REACH:
            raise ValueError(
                f'the field shows {x0:g} to {x1:g} m, not the turn and {REACH:g} m beside it'
            )
        self.chuck, self.clamped = chuck, (chuck.diameter, 0.5 * chuck.diameter - chuck.core)
        self._turns = 0
        self._samples = np.zeros(0, SAMPLE)
        flat = dataclasses.replace(params.part, warp=0.0)
        heat = dataclasses.replace(params.heat, table_conductance=CHUCK_CONDUCTANCE)
        super().__init__(part, dataclasses.replace(params, part=flat, heat=heat), seed)
        self._wire = float(self.metal.params['wire_diameter'][0])

    def placed_samples(self, samples: np.ndarray) -> np.ndarray:
        """As of Plant. The chuck knows turns: 1 m of the plant port's table_x is one."""
        placed = samples.copy()
        placed['table_x'] *= self.chuck.period
        return placed

    def step(self, samples: np.ndarray, time_us: int) -> Reading:
        """As of Plant; the chuck may have made any number of turns."""
        here = -float(samples['table_x'][-1]) - float(self._zero[0])
        self._turn_to(self.chuck.turns(here))
        turned = samples.copy()
        turned['table_x'] += self._turns * self.chuck.period
        self._samples = turned
        burned = bool(self.metal.state['active'][0])
        if burned:
            self._wire_by_radius()
        reading = super().step(turned, time_us)
        burned |= bool(self.metal.state['active'][0])
        if burned:
            for field in (self.metal.z, self.metal.solid, self.metal.touched):
                self._copy_around(field, self.metal.spec.origin_x, self.metal.spec.resolution)
        self._join_heat(burned)
        return reading

    def profiles(self, samples: np.ndarray) -> Profiles | None:
        """As of Plant."""
        return super().profiles(self._samples)

    def aim(self, x: float, y: float) -> None:
        """As of Plant."""
        super().aim(x - self.chuck.turns(x) * self.chuck.period, y)

    @property
    def metal_volume(self) -> float:
        """m^3 on the shaft above z = 0, each place once."""
        spec = self.metal.spec
        on = (spec.x >= self.chuck.first) & (spec.x < self.chuck.first + self.chuck.period)
        z = self.metal.z[:, on]
        high = z * (self.chuck.core + 0.5 * z) / self.chuck.scale
        return float(high.sum()) * spec.resolution**2

    def _turn_to(self, turns: int) -> None:
        """What remembers places comes along into the first turn."""
        step = (self._turns - turns) * self.chuck.period
        if not step:
            return
        for name in MOVED:
            self.metal.state[name] += step
        self.variation.state['last_x'] += step
        self._last[0] += step
        self._turns = turns

    def _wire_by_radius(self) -> None:
        """The metal of the wire on the area that the shaft has at the middle of the bead."""
        s, spec = self.metal.state, self.metal.spec
        at = spec.cell(float(s['pool_x'][0]), float(s['pool_y'][0]))
        row, col = int(np.clip(at[0], 0, spec.rows - 1)), int(np.clip(at[1], 0, spec.cols - 1))
        middle = float(self.metal.solid[row, col]) + 0.5 * float(s['height'][0])
        self.metal.params['wire_diameter'] = self._wire / math.sqrt(self.chuck.share(middle))

    def _copy_around(self, field: np.ndarray, origin: float, cell: float) -> None:
        """What lies within REACH of the torch, to its other showings. field: (rows, cols)."""
        turn, cols = round(self.chuck.period / cell), field.shape[1]
        x = float(self._last[0])
        begin, end = (math.floor((x + d - origin) / cell) for d in (-REACH, REACH))
        for step in (-turn, turn):
            a, b = max(begin + step, 0), min(end + step + 1, cols)
            if a < b:
                field[:, a:b] = field[:, a - step : b - step]

    def _join_heat(self, burned: bool) -> None:
        """The same for temperatures, which conduction changes everywhere: the rest is that of the first turn."""
        heat, spec = self.heat, self.heat.spec
        if not burned and float(heat.state['clock'][0]) > 0.011:
            return  # nothing was conducted in this step
        cell, turn = spec.resolution, round(self.chuck.period / spec.resolution)
        first = math.ceil((self.chuck.first - spec.origin_x) / cell - 0.5)
        for field in (heat.skin, heat.bulk, heat.thickness):
            if burned:
                self._copy_around(field, spec.origin_x, cell)
            field[:, :first] = field[:, turn : turn + first]
            behind = spec.cols - first - turn
            field[:, first + turn :] = field[:, first : first + behind]

    def _expose(self, samples: np.ndarray, times: np.ndarray, first_us: int) -> Profiles:
        """The scanner looks at the first turn as well, wherever the torch is."""
        ahead = self.params.scanner.offset_x
        x = -float(samples['table_x'][-1]) - float(self._zero[0]) + ahead
        step = self.chuck.turns(x) * self.chuck.period
        seen, before = samples.copy(), self._before
        seen['table_x'] += step
        self._before = before - (step, 0.0, 0.0)
        profiles = super()._expose(seen, times, first_us)
        self._before = before
        return profiles
