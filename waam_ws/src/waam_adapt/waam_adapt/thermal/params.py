"""Parameters of thermal_compensator; `config/thermal_compensator.yaml` lists the same."""

from __future__ import annotations

import math
from dataclasses import dataclass

from waam_node.params import param
from waam_process import materials

from .interpass import Settings


@dataclass(frozen=True)
class ThermalParams:
    """Parameters of the node thermal_compensator."""

    material: str = param(materials.DEFAULT, 'whose limit and law hold until a job names its own')
    materials_file: str = param(
        '', "operator's table that adds to or replaces the packaged materials"
    )
    interpass_limit: float = param(
        math.nan, 'the next layer starts below this; NaN = of the material', 'degC', 20.0, 1000.0
    )
    stuck_time: float = param(10.0, 'a reading that rests so long is stuck; 0 = never', 's', 0.0)

    @property
    def of_material(self) -> materials.Material:
        """The material that holds until a job names its own. MaterialError when the table does not have it."""
        return materials.get(self.material, self.materials_file or None)

    def limit_of(self, material: materials.Material) -> float:
        """Interpass limit in degC: that of the parameter, or of the material where none is given."""
        own = math.isnan(self.interpass_limit)
        return material.interpass_limit if own else self.interpass_limit

    @property
    def settings(self) -> Settings:
        """With the interpass limit of the material where none is given."""
        return Settings(self.limit_of(self.of_material), stuck_time=self.stuck_time)
