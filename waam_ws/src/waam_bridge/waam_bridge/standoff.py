"""The controller's standoff control, as this end sees it: its settings, and what it says. Until all settings are in the
controller, no job can be armed. Pure."""

from __future__ import annotations

import math

from waam_process.names import CONTROLLER_STATES, STANDOFF_LAWS, STANDOFF_SOURCES
from waam_process.units import mm, to_mm

from . import frames
from .machine import Machine
from .params import BridgeParams, CommonParams
from .settings import ControllerSettings, Setting

PERIOD_US = 50_000  # between two lines that are published
# where a parameter is NaN; mm, mm/s per mm, mm/s per mm and s
OF_SOURCE = {
    'laser': {
        'set_mm': 100.0, 'dead_mm': 0.03, 'jump_mm': 1.0, 'kp': 5.0, 'ki': 3.0,
        'lead_mm': 8.0, 'lost_s': 1.5, 'answer_mm': 1.0,
    },
    'infrared': {
        'set_mm': 100.0, 'dead_mm': 0.2, 'jump_mm': 3.0, 'kp': 2.0, 'ki': 0.5,
        'lead_mm': 8.0, 'lost_s': 1.5, 'answer_mm': 1.0,
    },
    'arc': {
        'set_mm': 15.0, 'dead_mm': 0.03, 'jump_mm': 1.0, 'kp': 2.0, 'ki': 0.5,
        'lead_mm': 0.0, 'lost_s': 0.5, 'answer_mm': 3.0,
    },
}  # fmt: skip


def settings(p: CommonParams) -> list[Setting]:
    """What is sent, in this order: off first and the source last, so that the controller judges the whole of it."""
    if not isinstance(p, BridgeParams) or p.standoff_source == STANDOFF_SOURCES[0]:
        return [('source', 0.0)]
    source = STANDOFF_SOURCES.index(p.standoff_source)
    chosen = {
        'set_mm': to_mm(p.standoff_set),
        'dead_mm': to_mm(p.standoff_dead_band),
        'jump_mm': to_mm(p.standoff_jump),
        'kp': p.standoff_kp,
        'ki': p.standoff_ki,
        'lead_mm': to_mm(p.standoff_lead),
    }
    usual = OF_SOURCE[p.standoff_source]
    values = usual | {name: v for name, v in chosen.items() if not math.isnan(v)}
    values['up_mm'], values['down_mm'] = to_mm(p.standoff_up), to_mm(p.standoff_down)
    values['rate_mm_s'] = to_mm(p.standoff_rate)
    values['cross_mm'] = to_mm(p.standoff_cross)
    values['arc_wander_mm'] = to_mm(p.standoff_arc_wander)
    values['law'] = float(STANDOFF_LAWS.index(p.standoff_law))
    return [('source', 0.0), *values.items(), ('source', float(source))]


class Standoff(ControllerSettings):
    """`problem`: why the controller cannot be armed, '' = its settings are those of the parameters."""

    name, capability, class_name = 'standoff control', 'STANDOFF', 'height'

    def __init__(self, params: CommonParams) -> None:
        super().__init__(settings(params))
        self._told = frames.Standoff(-PERIOD_US, 0, 0, 0, 0, 0, 0)

    @property
    def distance(self) -> float:
        """m that the sensor at the torch shall read; 0 = there is none."""
        values = dict(self._all)
        sensor = STANDOFF_SOURCES[int(values['source'])] in ('laser', 'infrared')
        return mm(values['set_mm']) if sensor else 0.0

    def change(self, params: CommonParams, machine: Machine) -> None:
        """The settings of these parameters from now on. ValueError when they cannot be taken; nothing changes then."""
        wanted = settings(params)
        if why := self._against(wanted, machine):
            raise ValueError(f'standoff control: {why}')
        self._all = wanted
        self._asked, self._refused = False, ''
        self._left = list(wanted) if machine.connected and self.able(machine) else []

    def _against(self, wanted: list[Setting], machine: Machine) -> str:
        if machine.armed_job:
            return f"job '{machine.armed_job}' is armed; end or disarm it first"
        if machine.connected and machine.queued:
            return f'{machine.queued} segments wait'
        if machine.connected and machine.state not in (frames.IDLE, frames.ALARM):
            return f'the controller is in {CONTROLLER_STATES[machine.state]}, not IDLE'
        return '' if self.able(machine) or len(wanted) == 1 else 'this controller has none'

    def heard(self, frame: frames.Standoff) -> bool:
        """Whether this line is to be published: 20 Hz of controller time, and every change of the alarm. A controller
        that is switched on although it shall be off is switched off."""
        self.switch_off()
        late = not 0 <= frame.t_us - self._told.t_us < PERIOD_US
        if not late and frame.alarm == self._told.alarm:
            return False
        self._told = frame
        return True
