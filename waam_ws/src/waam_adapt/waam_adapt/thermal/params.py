"""Parameters of thermal_compensator; `config/thermal_compensator.yaml` lists the same."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

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
    t_min: float = param(-20.0, 'lowest reading that is believed', 'degC', -60.0)
    t_max: float = param(1400.0, 'highest reading that is believed', 'degC', 100.0)
    jump: float = param(150.0, 'change between two samples that is taken for a fault', 'K', 1.0)
    confirm: int = param(5, 'samples in a row that turn a jump into a new level', '', 1, 100)
    step: float = param(
        40.0, 'fall between two samples that no metal cools by: emissivity jump', 'K', 1.0
    )
    step_top: float = param(800.0, 'above this metal may cool that fast', 'degC', 100.0)
    hold: float = param(10.0, 'time after an emissivity jump that nothing is believed', 's', 0.0)
    stuck_time: float = param(10.0, 'a reading that rests so long is stuck; 0 = never', 's', 0.0)
    stuck_band: float = param(0.01, 'and rests means: moves less than this', 'K', 0.0)
    timeout: float = param(2.0, 'silence (ROS time) after which nothing is believed', 's', 0.1)
    window: float = param(3.0, 'over which temperature and rate are fitted', 's', 0.5, 60.0)
    period: float = param(
        0.5, 'shortest time between messages without news (ROS time)', 's', 0.0, 5.0
    )

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
        limit = self.limit_of(self.of_material)
        names = [f.name for f in fields(Settings) if f.name != 'interpass_limit']
        return Settings(limit, **{name: getattr(self, name) for name in names})
