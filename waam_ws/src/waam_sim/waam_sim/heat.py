"""Where the arc's heat goes: two layers of coarse cells (skin and bulk) under the part, losses to table and air.

The skin is the top 8 mm (half of thinner parts), the bulk the rest. Heat flows sideways inside each layer, up and
down between them, into the table from the bulk, into the air from skin and flanks (convection and radiation). New
metal makes a cell thicker and takes its heat from the arc's: the balance closes. SI, temperatures in degrees Celsius.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_node.params import param
from waam_process.grid import GridSpec, HeightGrid

from .compiled import bilinear, jit, record, state


@dataclass(frozen=True)
class HeatParams:
    """Heat of the work-piece. Material values are those of low-alloy steel at some hundred degrees."""

    cell: float = 4e-3  # edge of a heat cell [m]
    ambient: float = param(22.0, 'temperature of air and table', 'degC', -20.0, 60.0)
    initial: float = param(22.0, 'temperature of a newly clamped part', 'degC', -20.0, 600.0)
    arc_efficiency: float = param(
        0.80, 'share of the electrical power that stays in the part', '', 0.1, 1.0
    )
    conductivity: float = param(42.0, 'of the metal', 'W/(m K)', 1.0, 400.0)
    heat_capacity: float = param(4.6e6, 'of the metal by volume', 'J/(m^3 K)', 1e6, 1e7)
    table_conductance: float = param(450.0, 'clamped contact to the table', 'W/(m^2 K)', 0.0, 2e4)
    air_conductance: float = param(15.0, 'convection', 'W/(m^2 K)', 0.0, 1e3)
    emissivity: float = param(0.75, 'of the oxidised surface, for radiation', '', 0.0, 1.0)
    step: float = 0.1  # time between two steps of conduction [s]


SKIN = 8e-3
THINNEST = 3e-3
BARE = 1e-3
STEFAN_BOLTZMANN = 5.670374e-8
KELVIN = 273.15


@dataclass
class Heat:
    """Temperatures of skin and bulk, (rows, cols), degrees Celsius; thickness (rows, cols) in m, 0 = bare table."""

    spec: GridSpec
    params: np.ndarray
    state: np.ndarray
    skin: np.ndarray
    bulk: np.ndarray
    thickness: np.ndarray

    @classmethod
    def of(cls, part: HeightGrid, params: HeatParams) -> Heat:
        """A part at its initial temperature; heat cells average the height cells below them."""
        x0, x1, y0, y1 = part.spec.extent
        spec = GridSpec.covering(x0, y0, x1, y1, params.cell)
        thickness = _mean_height(part, spec)
        start = np.where(thickness > BARE, params.initial, params.ambient)
        s = state('origin_x', 'origin_y', 'clock', 'arc_energy', 'lost', 'missed')
        s['origin_x'], s['origin_y'] = spec.origin_x, spec.origin_y
        return cls(spec, record(params), s, start.copy(), start.copy(), thickness)

    @property
    def content(self) -> float:
        """Heat above ambient, J."""
        p = self.params[0]
        d = np.maximum(self.thickness, THINNEST)
        d1 = np.where(d > 2 * SKIN, SKIN, 0.5 * d)
        both = d1 * (self.skin - p['ambient']) + (d - d1) * (self.bulk - p['ambient'])
        return float(both[self.thickness > BARE].sum() * p['heat_capacity'] * p['cell'] ** 2)

    @property
    def mean(self) -> float:
        """Mean temperature of the metal, degrees Celsius."""
        d = np.where(self.thickness > BARE, np.maximum(self.thickness, THINNEST), 0.0)
        p = self.params[0]
        volume = float(d.sum()) * p['cell'] ** 2
        return (
            float(p['ambient'] + self.content / (volume * p['heat_capacity']))
            if volume
            else float(p['ambient'])
        )

    def at(self, x: float, y: float) -> float:
        """Skin temperature at a point (m, work frame); ambient outside."""
        p = self.params[0]
        return float(
            bilinear(
                self.skin, self.spec.origin_x, self.spec.origin_y, p['cell'], x, y, p['ambient']
            )
        )


def _mean_height(part: HeightGrid, spec: GridSpec) -> np.ndarray:
    x, y = np.meshgrid(part.spec.x, part.spec.y)
    row, col = spec.cell(x.ravel(), y.ravel())
    index = np.clip(row, 0, spec.rows - 1) * spec.cols + np.clip(col, 0, spec.cols - 1)
    total = np.bincount(index, part.z.ravel(), spec.rows * spec.cols)
    count = np.bincount(index, minlength=spec.rows * spec.cols)
    return np.maximum(total / np.maximum(count, 1), 0.0).reshape(spec.shape)


@jit
def split(thickness):
    """Thickness of skin and of bulk, m."""
    d = max(thickness, THINNEST)
    skin = SKIN if d > 2.0 * SKIN else 0.5 * d
    return skin, d - skin


@jit
def grow(skin, bulk, thickness, p, s, x, y, volume):
    """Adds metal (m^3) that arrives with the arc's heat; heats it from the cell's own content."""
    c, r = int((x - s.origin_x) // p.cell), int((y - s.origin_y) // p.cell)
    if r < 0 or c < 0 or r >= skin.shape[0] or c >= skin.shape[1]:
        return
    t0 = p.ambient
    a1, a2 = split(thickness[r, c])
    bare = thickness[r, c] <= BARE
    thickness[r, c] += volume / (p.cell * p.cell)
    b1, b2 = split(thickness[r, c])
    if bare:
        skin[r, c], bulk[r, c] = t0, t0
        return
    total = a1 * (skin[r, c] - t0) + a2 * (bulk[r, c] - t0)
    below = a2 * (bulk[r, c] - t0) + (b2 - a2) * (skin[r, c] - t0)
    bulk[r, c] = t0 + below / b2
    skin[r, c] = t0 + (total - below) / b1


@jit
def add_arc(skin, thickness, p, s, x, y, energy):
    """Heat of the arc (J, electrical) into the four cells around a point."""
    s.arc_energy += energy
    into = energy * p.arc_efficiency
    u = (x - s.origin_x) / p.cell - 0.5
    v = (y - s.origin_y) / p.cell - 0.5
    c, r = int(np.floor(u)), int(np.floor(v))
    for i in range(2):
        for j in range(2):
            weight = (v - r if i else 1.0 - v + r) * (u - c if j else 1.0 - u + c)
            m, n = r + i, c + j
            inside = m >= 0 and n >= 0 and m < skin.shape[0] and n < skin.shape[1]
            if inside and thickness[m, n] > BARE:
                d1 = split(thickness[m, n])[0]
                skin[m, n] += weight * into / (p.heat_capacity * d1 * p.cell * p.cell)
            else:
                s.missed += weight * into


@jit
def _surface_loss(p, t, area):
    """W, to the air by convection and radiation."""
    k, k0 = t + KELVIN, p.ambient + KELVIN
    flux = p.air_conductance * (t - p.ambient) + p.emissivity * STEFAN_BOLTZMANN * (k**4 - k0**4)
    return flux * area


@jit
def conduct(skin, bulk, thickness, p, s, dt):
    """One explicit step of conduction and losses."""
    rows, cols = skin.shape
    face = p.cell * p.cell
    q1, q2 = np.zeros((rows, cols)), np.zeros((rows, cols))
    for r in range(rows):
        for c in range(cols):
            if thickness[r, c] <= BARE:
                continue
            d1, d2 = split(thickness[r, c])
            down = p.conductivity * face / (0.5 * (d1 + d2)) * (skin[r, c] - bulk[r, c])
            table = p.table_conductance * face * (bulk[r, c] - p.ambient)
            air = _surface_loss(p, skin[r, c], face)
            q1[r, c] -= down + air
            q2[r, c] += down - table
            s.lost += (table + air) * dt
            for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                m, n = r + dr, c + dc
                inside = m >= 0 and n >= 0 and m < rows and n < cols
                if inside and thickness[m, n] > BARE:
                    if dr + dc > 0:
                        e1, e2 = split(thickness[m, n])
                        f1 = p.conductivity * min(d1, e1) * (skin[m, n] - skin[r, c])
                        f2 = p.conductivity * min(d2, e2) * (bulk[m, n] - bulk[r, c])
                        q1[r, c], q1[m, n] = q1[r, c] + f1, q1[m, n] - f1
                        q2[r, c], q2[m, n] = q2[r, c] + f2, q2[m, n] - f2
                else:
                    flank1 = _surface_loss(p, skin[r, c], d1 * p.cell)
                    flank2 = _surface_loss(p, bulk[r, c], d2 * p.cell)
                    q1[r, c] -= flank1
                    q2[r, c] -= flank2
                    s.lost += (flank1 + flank2) * dt
    for r in range(rows):
        for c in range(cols):
            if thickness[r, c] > BARE:
                d1, d2 = split(thickness[r, c])
                skin[r, c] += q1[r, c] * dt / (p.heat_capacity * d1 * face)
                bulk[r, c] += q2[r, c] * dt / (p.heat_capacity * d2 * face)
