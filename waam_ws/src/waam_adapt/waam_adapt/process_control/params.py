"""Parameters of process_control; `config/process_control.yaml` lists the same."""

from __future__ import annotations

import math
from dataclasses import dataclass

from waam_node.params import ParameterError, param
from waam_process import materials

VALUES = ('none', 'current', 'power', 'heat_input')


@dataclass(frozen=True)
class ProcessControlParams:
    """Parameters of the node process_control."""

    value: str = param('none', 'what is held; none = the node does nothing', choices=VALUES)
    setpoint: float = param(
        0.0,
        "the value (A, W or J/m) at the material's default regime; 0 = what the material's table gives there",
        '',
        0.0,
    )
    keep_metal: bool = param(
        True,
        'speed and wire move together, so that the metal per length stays what the corrections want; '
        'false: wire alone (current, power) or speed alone (heat input)',
    )
    material: str = param(materials.DEFAULT, 'whose regime the setpoint belongs to')
    materials_file: str = param(
        '', "operator's table that adds to or replaces the packaged materials"
    )
    kp: float = param(0.3, 'relative change of the value per relative error', '', 0.0, 5.0)
    ki: float = param(2.5, 'and per second', '1/s', 0.0, 50.0)
    settle: float = param(0.5, 'after arc start and after corners before it acts', 's', 0.0, 10.0)
    timeout: float = param(
        0.2, 'without telemetry for so long (steady time) it is frozen', 's', 0.05, 5.0
    )

    def __post_init__(self) -> None:
        if self.value == 'none' or self.of_material.arc_current > 0:
            return
        raise ParameterError(
            f"material '{self.material}' has no arc_current: process_control cannot know how the current "
            'follows the wire feed'
        )

    @property
    def of_material(self) -> materials.Material:
        """MaterialError when the table does not have it."""
        return materials.get(self.material, self.materials_file or None)

    @property
    def level(self) -> float:
        """The chosen value over that of the material's table at its default regime."""
        m = self.of_material
        regime = reference(self.value, m.set_current(m.wire_feed), m.voltage, m.speed)
        return self.setpoint / regime if self.setpoint else 1.0


def reference(value: str, current: float, voltage: float, speed: float) -> float:
    """The value (A, W or J/m) of a current (A), voltage (V) and travel speed (m/s); NaN at rest."""
    if value == 'current':
        return current
    if value == 'power':
        return current * voltage
    return current * voltage / speed if speed > 0 else math.nan
