"""Settings that this end brings into the controller: the standoff control, the temperature of the part. Pure.

The controller keeps them until it loses its power, so they are sent whenever a controller is met that may have others.
They are taken only in IDLE or ALARM with an empty queue.
"""

from __future__ import annotations

from . import frames, requests
from .machine import Machine
from .outbox import FAULT
from .program import number

NOT_NOW = 'E108'
Setting = tuple[str, float]


class ControllerSettings:
    """One group of settings. `wanted`: names and values in the order of sending; one line alone switches the group
    off. `name`: as people call it; `capability`: of a controller that has it; `class_name`: of its anomalies."""

    name = capability = class_name = ''

    def __init__(self, wanted: list[Setting]) -> None:
        self._all = wanted
        self._left: list[Setting] = []
        self._asked = False
        self._refused = ''

    @property
    def on(self) -> bool:
        """Whether it is to be used."""
        return len(self._all) > 1

    @property
    def problem(self) -> str:
        """Why it cannot be used, '' = nothing stands against it."""
        if self._refused:
            return self._refused
        if self._left and self.on:
            return f'the settings of the {self.name} are not in the controller yet'
        return ''

    @property
    def settled(self) -> bool:
        """Nothing is left to send."""
        return bool(self._refused) or not self._left

    def met(self, machine: Machine) -> None:
        """A controller that may have other settings."""
        self._asked, self._refused, self._left = False, '', []
        if not self.on:
            return
        if self.able(machine):
            self._left = list(self._all)
        else:
            self._refuse(machine, f'the controller has no {self.name}')

    def able(self, machine: Machine) -> bool:
        """Whether the controller that is there has it; also while none is."""
        return not machine.connected or self.capability in machine.link.who.capabilities

    def switch_off(self) -> None:
        """The controller was left switched on although it shall be off."""
        if not self.on and not self._left:
            self._left = list(self._all)

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
                self._refuse(machine, f'setting {name} of the {self.name}: {text}')

        machine.link.ask('C', f'{name} {number(value, 5)}', done, now)

    def _refuse(self, machine: Machine, text: str) -> None:
        self._refused = text
        machine.notice(FAULT, self.class_name, text, 'none')
