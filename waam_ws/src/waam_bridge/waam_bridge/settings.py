"""Settings that this end brings into the controller: gantry, standoff control, temperature of the part. Pure.

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

    @property
    def due(self) -> bool:
        """Whether there is something to ask or send."""
        return bool(self._left) and not self._refused

    def poll(self, machine: Machine, now: float) -> None:
        """Sends the next setting, or asks for all, when the controller can take it."""
        idle = machine.state in (frames.IDLE, frames.ALARM) and not machine.queued
        if not self.due or self._asked or not idle:
            return
        self._asked, sent = True, self._left

        def done(code: int, text: str) -> None:
            if self._left is not sent:  # an answer to settings that were replaced meanwhile
                return
            self._asked = False
            if code == requests.OK and sent:
                self._left = sent[1:]
            elif code == requests.OK:
                self.told(machine, text)
            elif code == requests.REFUSED and NOT_NOW not in text:
                which = f'setting {sent[0][0]}' if sent else 'the settings'
                self._refuse(machine, f'{which} of the {self.name}: {text}')

        line = f'{sent[0][0]} {number(sent[0][1], 5)}' if sent else ''
        machine.link.ask('C', line, done, now)

    def told(self, machine: Machine, text: str) -> None:
        """The controller's answer to the question for all settings."""

    def _refuse(self, machine: Machine, text: str) -> None:
        self._refused = text
        machine.notice(FAULT, self.class_name, text, 'none')
