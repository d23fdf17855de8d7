"""What is looked for, what is believed of it before any record is read, and what records of a job can never tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from waam_sim.config import GROUPS
from waam_sim.plant import PlantParams

METAL, HEAT, ARC = 'metal', 'heat', 'arc'


@dataclass(frozen=True)
class Unknown:
    """A parameter of the simulated cell. Before the records it is believed to be `usual` +- `spread` (normal; `log`:
    its logarithm, spread being relative). `doubt`: what the laying of a record anew is wrong by, in the same unit;
    found on cells whose parameters were known (docs/twin.md)."""

    group: str
    field: str
    usual: float
    spread: float
    doubt: float
    log: bool = False

    @property
    def name(self) -> str:
        """As in a cell file: metal_transfer."""
        return f'{self.group}_{self.field}'

    @property
    def words(self) -> str:
        """What it is, in words."""
        return str(self._meta()['description'])

    @property
    def unit(self) -> str:
        """'' = none."""
        return str(self._meta()['unit'])

    def value(self, u: np.ndarray | float) -> Any:
        """From standard deviations about what is usual to the parameter, within its limits."""
        x = (
            self.usual * np.exp(self.spread * np.asarray(u))
            if self.log
            else self.usual + self.spread * np.asarray(u)
        )
        low, high = self._limits()
        return np.clip(x, low, high)

    def standard(self, value: float) -> float:
        """The other way round."""
        if self.log:
            return float(np.log(value / self.usual) / self.spread)
        return (value - self.usual) / self.spread

    def _meta(self) -> Mapping[str, Any]:
        group: Any = GROUPS[self.group]
        return next(f.metadata for f in fields(group) if f.name == self.field)

    def _limits(self) -> tuple[float, float]:
        meta = self._meta()
        low = -np.inf if meta['minimum'] is None else meta['minimum']
        high = np.inf if meta['maximum'] is None else meta['maximum']
        if self.field == 'current_exponent':
            low, high = 0.51, 0.95  # beyond, the law of the melting wire has no solution
        return float(low), float(high)


# Laid anew: found together, for each of them moves the metal or the heat a little.
REPLAYED = (
    Unknown(METAL, 'transfer', 0.90, 0.06, 0.012),
    Unknown(METAL, 'width_ref', 7.0e-3, 0.5e-3, 0.12e-3),
    Unknown(METAL, 'levelling', 0.55, 0.15, 0.03),
    Unknown(METAL, 'pool_lag', 0.45, 0.15, 0.08),
    Unknown(METAL, 'crater_depth', 0.35, 0.15, 0.04),
    Unknown(METAL, 'start_narrowing', 0.15, 0.10, 0.03),
    Unknown(METAL, 'speed_exponent', 0.65, 0.08, 0.03),
    Unknown(METAL, 'spatter_per_m', 7.0, 2.0, 1.0),
    Unknown(METAL, 'hot_width_per_k', 4e-4, 1.5e-4, 1e-4),
    Unknown(HEAT, 'arc_efficiency', 0.80, 0.06, 0.02),
    Unknown(HEAT, 'table_conductance', 450.0, 0.5, 0.065, log=True),
)
# From current and voltage while the arc burns.
ELECTRIC = (
    Unknown(ARC, 'current_ref', 138.0, 12.0, 0.8),
    Unknown(ARC, 'current_exponent', 0.65, 0.08, 0.01),
    Unknown(ARC, 'current_per_m', 24.0, 6.0, 4.0),
)
SCATTER = (
    Unknown(METAL, 'area_noise_layer', 0.040, 0.45, 0.08, log=True),
    Unknown(ARC, 'length_noise', 0.45, 0.6, 0.12, log=True),
    Unknown(ARC, 'current_noise', 7.0, 0.45, 0.13, log=True),
)
ALL = REPLAYED + ELECTRIC + SCATTER

# Never looked for, and why: parameter -> reason, in words.
NEVER: Mapping[str, str] = {
    'arc_wire_ratio, metal_wire_diameter': 'metal grows with wire_ratio x wire_diameter^2 x transfer; a record '
    'shows the product alone. Both stay as they were and metal_transfer takes what is left. '
    'Weigh a metre of wire, and feed one against a rule, to tell them apart',
    'heat_heat_capacity': 'a temperature rises with arc_efficiency over heat_capacity; the capacity stays that of the '
    'material',
    'heat_conductivity': 'a property of the material; in a record it looks like a pyrometer that is aimed a few '
    'millimetres beside',
    'heat_air_conductance, heat_emissivity': 'table_conductance takes the heat away in much the same way',
    'arc_sensor_noise': 'the quick scatter of the current that does not go with the voltage is that of sensor, wire '
    'and contact distance together',
    'pyrometer_emissivity': 'it shifts all temperatures alike, as arc_efficiency does; check the pyrometer against a '
    'thermocouple',
    'metal_area_noise_fixed': 'scatter that returns in every layer looks like a part that was planned wrongly, unless '
    'one part is laid many times',
    'variation_lateral, variation_layer, metal_width_follows': 'one figure of unevenness, metal_area_noise_layer, '
    'takes all scatter of beads; a preset of the cell says the others',
    'arc_drift_current, arc_drift_voltage': 'slow changes of the current are those of drift, wire and contact distance '
    'together; a preset of the cell says them',
    'metal_slump_slope': 'edges are left out of the comparison: scanners see them badly',
    'arc_wire_delay, arc_wire_lag': 'telemetry has ten rows a second; `waam calibrate lead` measures them at 100',
    'arc_strike_failure': 'a job strikes too few arcs to tell',
}


def physics(base: PlantParams, values: Mapping[str, float]) -> PlantParams:
    """`base` with other parameters; names as in a cell file (metal_transfer)."""
    groups: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        group, _, field = name.partition('_')
        groups.setdefault(group, {})[field] = float(value)
    changed = {g: replace(getattr(base, g), **own) for g, own in groups.items()}
    return replace(base, **changed)
