"""The temperature of the part that the controller measures: its settings, and what it says. Pure."""

from __future__ import annotations

from waam_process.names import TEMPERATURE_INPUTS

from . import frames
from .machine import Machine
from .outbox import INFO, WARNING
from .params import BridgeParams, CommonParams
from .settings import ControllerSettings, Setting

FAULTS = (  # of a P line
    '', "the signal is below the instrument's range: broken wire, no supply, or too cold",
    "the signal is above the instrument's range: short circuit, open thermocouple, or too hot",
    'the converter gives no reading',
)  # fmt: skip


def settings(p: CommonParams) -> list[Setting]:
    """What is sent, in this order: off first and the input last, so that the controller judges the whole of it."""
    off = ('temperature_input', 0.0)
    if not isinstance(p, BridgeParams) or p.temperature_input == TEMPERATURE_INPUTS[0]:
        return [off]
    kind = TEMPERATURE_INPUTS.index(p.temperature_input)
    ends = [('temperature_low_c', p.temperature_low), ('temperature_high_c', p.temperature_high)]
    return [off, *ends, ('temperature_input', float(kind))]


class PartTemperature(ControllerSettings):
    """`says`: for the diagnostics, the input and what it reads, or why that is unknown; '' = not used."""

    name, capability, class_name = "input for the part's temperature", 'TEMPERATURE', 'temperature'

    def __init__(self, params: CommonParams) -> None:
        super().__init__(settings(params))
        self._input = getattr(params, 'temperature_input', TEMPERATURE_INPUTS[0])
        self._fault = 0
        self._newest: frames.PartTemperature | None = None

    @property
    def says(self) -> str:
        """See the class."""
        if not self.on:
            return ''
        t = self._newest
        told = FAULTS[t.fault] or f'{t.celsius:.1f} degC' if t else 'nothing yet'
        return f'{self._input}: {self.problem or told}'

    def heard(self, frame: frames.PartTemperature, machine: Machine) -> bool:
        """Whether this line is to be published. A controller that measures although it shall not is switched off."""
        self.switch_off()
        if not self.on:
            return False
        if frame.fault != self._fault:
            self._fault = frame.fault
            why = FAULTS[frame.fault]
            text = f"the part's temperature ({self._input} at the controller) is "
            said = f'unknown: {why}' if why else 'known again'
            machine.notice(WARNING if why else INFO, self.class_name, text + said)
        self._newest = frame
        return True
