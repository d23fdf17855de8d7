"""The gantry as the parameters describe it: told to the controller, read back, compared. Pure.

The controller keeps these settings until it loses its power. Only what differs is sent, because another envelope loses
homing. Until both agree, no job can be armed and nothing homes.
"""

from __future__ import annotations

import math

from waam_process.units import to_mm

from .machine import Machine
from .params import BridgeParams, CommonParams
from .settings import ControllerSettings, Setting

CALIBRATED = 0.05  # share by which calibrated steps per mm may differ from those of the parameters
# of the controller, per second: 1 ms has room for so many (WAAM_STEP_RATE_MOST of the firmware)
MAX_STEP_RATE = 77_000
STEPS, SPEED, ENVELOPE = 'steps_per_mm_', 'max_speed_', 'envelope_'
NAMES = tuple(f'{ENVELOPE}{a}' for a in 'xyz') + (
    'rapid_speed', 'max_accel_z', 'accel_limit_x', 'accel_limit_y', 'home_seek_speed', 'home_latch_speed',
    'home_direction_x', 'home_direction_y',
    *(f'{group}{a}' for group in (SPEED, STEPS) for a in 'xyz'),
)  # fmt: skip


def wanted(p: CommonParams) -> dict[str, float]:
    """The settings that are given, as the controller calls and counts them: mm, mm/s, mm/s^2. None of a robot."""
    given: dict[str, float] = {}
    if not isinstance(p, BridgeParams):
        return given
    for name in NAMES:
        value = getattr(p, name)
        if value and not math.isnan(value):
            plain = name.startswith(('home_direction', STEPS))
            given[name] = float(value) if plain else to_mm(value)
    return given


def differing(want: dict[str, float], told: dict[str, float]) -> list[Setting]:
    """What must be sent, in an order in which no steps and speed that go together only at the end are refused."""
    found: list[tuple[int, str, float]] = []
    for name, value in want.items():
        has = told.get(name, math.nan)
        steps = name.startswith(STEPS)
        if abs(has - value) <= (CALIBRATED * value if steps else 1e-3):
            continue
        falls = name.startswith(SPEED) and value < has
        found.append((0 if falls else 1 if steps else 2, name, value))
    return [(name, value) for _, name, value in sorted(found, key=lambda f: f[0])]


def parse(text: str) -> dict[str, float]:
    """The answer to `$C` alone; {} when it is none."""
    try:
        return {n: float(v) for n, _, v in (word.partition('=') for word in text.split())}
    except ValueError:
        return {}


class Gantry(ControllerSettings):
    """`problem`: why the controller must not move as it is, '' = it has what the parameters say."""

    name, class_name = 'gantry', 'motion'

    def __init__(self, params: CommonParams) -> None:
        super().__init__([])
        self._want = wanted(params)
        self._agreed = self._sent = False

    @property
    def problem(self) -> str:
        """See the class."""
        if self.settled:
            return self._refused
        return f'the settings of the {self.name} are not in the controller yet'

    @property
    def settled(self) -> bool:
        """Nothing is left to ask or send."""
        return not self._want or self._agreed or bool(self._refused)

    @property
    def due(self) -> bool:
        """See ControllerSettings."""
        return not self.settled

    def met(self, machine: Machine) -> None:
        """See ControllerSettings."""
        self._left, self._refused = [], ''
        self._asked = self._agreed = self._sent = False

    def told(self, machine: Machine, text: str) -> None:
        """Compares; what differs is sent once."""
        told = parse(text)
        needed = {*self._want, *(ENVELOPE + axis for axis in 'xyz')}
        if not told.keys() >= needed:  # older firmware has not all of them
            self._refuse(machine, f"the controller does not tell the gantry's settings: '{text}'")
            return
        self._left = differing(self._want, told)
        if self._left and self._sent:
            name, value = self._left[0]
            text = f'the controller has {name} {told.get(name):g}, the parameters say {value:g}'
            self._refuse(machine, text)
            return
        self._agreed, self._sent = not self._left, True
        low = machine.link.who.limits_mm[:3]
        machine.link.reaches((*low, *(told[ENVELOPE + axis] for axis in 'xyz')))
        machine.outbox.changed = True
