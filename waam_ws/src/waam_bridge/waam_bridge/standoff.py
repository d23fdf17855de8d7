"""The controller's standoff control, as this end sees it: brings its settings into the controller. Pure.

The controller keeps them until it loses its power, so they are sent whenever a controller is met that may have others.
They are taken only in IDLE or ALARM with an empty queue; until all are in, no job can be armed.
"""

from __future__ import annotations

import math

from waam_process.names import CONTROLLER_STATES, STANDOFF_LAWS, STANDOFF_SOURCES
from waam_process.units import mm, to_mm

from . import frames, requests
from .machine import Machine
from .outbox import FAULT
from .params import BridgeParams
from .program import number

CAPABILITY = 'STANDOFF'
NOT_NOW = 'E108'
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
Setting = tuple[str, float]


def settings(p: BridgeParams) -> list[Setting]:
    """What is sent, in this order: off first and the source last, so that the controller judges the whole of it."""
    source = STANDOFF_SOURCES.index(p.standoff_source)
    if source == 0:
        return [('source', 0.0)]
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


class Standoff:
    """`problem`: why the controller cannot be armed, '' = its settings are those of the parameters."""

    def __init__(self, params: BridgeParams) -> None:
        self._all = settings(params)
        self._on = len(self._all) > 1
        self._left: list[Setting] = []
        self._asked = False
        self._refused = ''
        self._told = frames.Standoff(-PERIOD_US, 0, 0, 0, 0, 0, 0)

    @property
    def problem(self) -> str:
        """Why the controller cannot be armed, '' = nothing stands against it."""
        if self._refused:
            return self._refused
        if self._left and self._on:
            return 'the settings of the standoff control are not in the controller yet'
        return ''

    @property
    def distance(self) -> float:
        """m that the sensor at the torch shall read; 0 = there is none."""
        values = dict(self._all)
        sensor = STANDOFF_SOURCES[int(values['source'])] in ('laser', 'infrared')
        return mm(values['set_mm']) if sensor else 0.0

    @property
    def settled(self) -> bool:
        """Nothing is left to send."""
        return bool(self._refused) or not self._left

    def met(self, machine: Machine) -> None:
        """A controller that may have other settings."""
        self._asked, self._refused, self._left = False, '', []
        if not self._on:
            return
        if _able(machine):
            self._left = list(self._all)
        else:
            self._refuse(machine, 'the controller has no standoff control')

    def change(self, params: BridgeParams, machine: Machine) -> None:
        """The settings of these parameters from now on. ValueError when they cannot be taken; nothing changes then."""
        wanted = settings(params)
        if why := self._against(wanted, machine):
            raise ValueError(f'standoff control: {why}')
        self._all, self._on = wanted, len(wanted) > 1
        self._asked, self._refused = False, ''
        self._left = list(wanted) if machine.connected and _able(machine) else []

    @staticmethod
    def _against(wanted: list[Setting], machine: Machine) -> str:
        if machine.armed_job:
            return f"job '{machine.armed_job}' is armed; end or disarm it first"
        if machine.connected and machine.queued:
            return f'{machine.queued} segments wait'
        if machine.connected and machine.state not in (frames.IDLE, frames.ALARM):
            return f'the controller is in {CONTROLLER_STATES[machine.state]}, not IDLE'
        return '' if _able(machine) or len(wanted) == 1 else 'this controller has none'

    def heard(self, frame: frames.Standoff) -> bool:
        """Whether this line is to be published: 20 Hz of controller time, and every change of the alarm. A controller
        that is switched on although it shall be off is switched off."""
        if not self._on and not self._left:
            self._left = list(self._all)
        late = not 0 <= frame.t_us - self._told.t_us < PERIOD_US
        if not late and frame.alarm == self._told.alarm:
            return False
        self._told = frame
        return True

    def poll(self, machine: Machine, now: float) -> None:
        """Sends the next setting when the controller can take it."""
        waits = self._asked or not self._left or self._refused
        if waits or machine.queued or machine.state not in (frames.IDLE, frames.ALARM):
            return
        name, value = self._left[0]
        self._asked, sent = True, self._left

        def done(code: int, text: str) -> None:
            if self._left is not sent:  # an answer to settings that were replaced meanwhile
                return
            self._asked = False
            if code == requests.OK:
                self._left = self._left[1:]
            elif code == requests.REFUSED and NOT_NOW not in text:
                self._refuse(machine, f'setting {name} of the standoff control: {text}')

        machine.link.ask('C', f'{name} {number(value, 5)}', done, now)

    def _refuse(self, machine: Machine, text: str) -> None:
        self._refused = text
        machine.notice(FAULT, 'height', text, 'none')


def _able(machine: Machine) -> bool:
    """Whether the controller that is there has a standoff control; also while none is."""
    return not machine.connected or CAPABILITY in machine.link.who.capabilities
