"""The robot cell that a program is for: positioner, frames, outputs, arc data. SI, angles in degrees; checked."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any

from waam_plan.robot.motion import RobotProgramError
from waam_plan.settings import within
from waam_process.segment import Point
from waam_robot.positioner import Positioner
from waam_robot.split import SplitLimits

POSITIONERS = ('none', 'hold', 'turn', 'place')
TIME_BEFORE_MAX = 30.0  # s, of Fanuc's `TB`
TIME_AFTER_MAX = 0.5  # s, of Fanuc's `TA`
NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,15}')


def _check(settings: object, error: str) -> None:
    """RobotProgramError that names a field whose value is none."""
    for f in fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, f.name)
        told = _problem(f, value)
        if told:
            raise RobotProgramError(f'{error}{f.name} is {value!r}, {told}')


def _problem(f: Field, value: object) -> str:
    default = f.default
    if isinstance(default, bool):
        return '' if isinstance(value, bool) else 'must be true or false'
    if isinstance(default, str):
        return '' if isinstance(value, str) and NAME.fullmatch(value) else 'must be a name'
    if isinstance(default, tuple) and (not isinstance(value, tuple) or len(value) != 3):
        return 'must be three numbers'
    low, high = f.metadata.get('range', (-math.inf, math.inf))
    for v in value if isinstance(value, tuple) else (value,):
        if isinstance(default, int) and not (isinstance(v, int) and not isinstance(v, bool)):
            return 'must be a whole number'
        if isinstance(default, int | float | tuple) and not (
            isinstance(v, int | float) and not isinstance(v, bool) and low <= v <= high
        ):
            return f'must be between {low:g} and {high:g}'
    return ''


@dataclass(frozen=True)
class FanucSettings:
    """Numbers of frames and outputs; registers: parameters in R[], set in the main program."""

    user_frame: int = within(1, 1, 9)
    user_tool: int = within(1, 1, 10)
    arc_output: int = within(1, 1, 4096)
    gas_output: int = within(2, 1, 4096)
    feed_output: int = within(1, 1, 4096)  # AO, m/min
    voltage_output: int = within(2, 0, 4096)  # AO, V; 0 = none
    # s before the end of a bead at which its arc goes off (TB); below 0: after it (TA)
    lead: float = within(0.1, -TIME_AFTER_MAX, TIME_BEFORE_MAX)
    smoothing: int = within(100, 0, 100)  # highest CNT along a bead
    blend_time: float = within(
        0.1, 0.01, 2.0
    )  # s over which the controller evens out a corner at CNT100
    registers: bool = True

    def __post_init__(self) -> None:
        _check(self, 'fanuc: ')


@dataclass(frozen=True)
class KukaSettings:
    """tool, base: numbers; machine: of the positioner in MACHINE_DEF; channels of the welding device in stArcDat_T."""

    tool: int = within(1, 1, 128)
    base: int = within(1, 1, 128)
    machine: int = within(2, 2, 16)
    feed_channel: int = within(2, 1, 8)  # m/min
    voltage_channel: int = within(1, 0, 8)  # V; 0 = none

    def __post_init__(self) -> None:
        _check(self, 'kuka: ')


@dataclass(frozen=True)
class AbbSettings:
    """tool: a tooldata of the cell; unit: the positioner's mechanical unit. Arc data in SI_UNITS: mm/s and V."""

    tool: str = 'tWeldGun'
    unit: str = 'STN1'

    def __post_init__(self) -> None:
        _check(self, 'abb: ')


@dataclass(frozen=True)
class RobotCell:
    """What all languages share.

    positioner: 'none': the program has no external axes; 'hold': they stand still; 'turn': C follows the bead where the
    split of source 003 allows it and B keeps the torch upright; 'place': C is a function of where the torch is, and B
    is 0. turning: of 'place': C at work zero, beside where it stands still, degrees, and per mm of x and of y
    (`waam plan --turning` chooses it). origin: work zero on the faceplate, m. orientation: W, P, R of an upright torch,
    degrees. corner: how far the robot may leave the path where two moves meet, m; zone: the
    longest stretch that it may round off, m.
    """

    positioner: str = 'none'
    turning: Point = within((0.0, 0.0, 0.0), -3600.0, 3600.0)
    origin: Point = within((-0.2, -0.15, 0.0), -10.0, 10.0)
    orientation: Point = within((180.0, 0.0, 0.0), -360.0, 360.0)
    corner: float = within(6e-6, 0.0, 5e-3)
    zone: float = within(1e-3, 0.0, 20e-3)
    pre_flow: float = within(0.3, 0.0, TIME_BEFORE_MAX)  # s of gas before the arc is lit
    post_flow: float = within(1.0, 0.0, TIME_BEFORE_MAX)  # s of gas after the arc went off
    # from the robot's frame to the tilt axis, m: table 2.1 of source 003
    positioner_tilt_x: float = within(1.2, -20.0, 20.0)
    positioner_tilt_y: float = within(0.0, -20.0, 20.0)
    positioner_tilt_z: float = within(0.35, -20.0, 20.0)
    positioner_plate_z: float = within(0.15, -5.0, 5.0)  # from the tilt axis to the faceplate, m
    turn_zero_deg: float = within(
        90.0, -360.0, 360.0
    )  # how far the faceplate is turned back at C = 0
    turn_low_deg: float = within(-36000.0, -1e6, 0.0)  # range of C
    turn_high_deg: float = within(36000.0, 0.0, 1e6)
    split_delta0: float = within(0.2e-3, 1e-6, 10e-3)  # limits of the split: S3 eqs 2.15 to 2.17
    split_delta1: float = within(0.02, 1e-4, 1.0)
    split_r_crit: float = within(10e-3, 0.0, 1.0)
    fanuc: FanucSettings = field(default_factory=FanucSettings)
    kuka: KukaSettings = field(default_factory=KukaSettings)
    abb: AbbSettings = field(default_factory=AbbSettings)

    def __post_init__(self) -> None:
        if self.positioner not in POSITIONERS:
            raise RobotProgramError(
                f'positioner is {self.positioner!r}, must be one of {", ".join(POSITIONERS)}'
            )
        _check(self, '')
        if any(self.turning) and self.positioner != 'place':
            raise RobotProgramError("turning belongs to positioner 'place'")

    def turn_at(self, place: Point) -> float:
        """C (rad) for a place (m, work frame) where it is a function of that."""
        start, x, y = self.turning
        return math.radians(start + 1e3 * (x * place[0] + y * place[1]) - self.turn_zero_deg)

    @property
    def axes(self) -> bool:
        """Whether programs have external axes."""
        return self.positioner != 'none'

    @property
    def device(self) -> Positioner:
        """The positioner's geometry."""
        return Positioner(
            a_b=self.positioner_tilt_x,
            d_bb=-self.positioner_tilt_y,
            d_b=self.positioner_tilt_z,
            d_c=self.positioner_plate_z,
            turn_zero=math.radians(self.turn_zero_deg),
            low=(-2.1, math.radians(self.turn_low_deg)),
            high=(2.1, math.radians(self.turn_high_deg)),
        )

    @property
    def limits(self) -> SplitLimits:
        """Where C may follow a bead."""
        return SplitLimits(self.split_delta0, self.split_delta1, max(self.split_r_crit, 1e-9))


_PARTS = {'fanuc': FanucSettings, 'kuka': KukaSettings, 'abb': AbbSettings}


def cell_of(data: object, where: str) -> RobotCell:
    """From a mapping (YAML). RobotProgramError that names file and field."""
    try:
        return RobotCell(**_given(RobotCell, data, ''))
    except RobotProgramError as e:
        raise RobotProgramError(f'{where}: {e}') from None


def _given(kind: Any, data: object, prefix: str) -> dict[str, Any]:
    """Values of the fields of a settings class."""
    if data is None:
        return {}
    if not isinstance(data, Mapping):
        raise RobotProgramError(f'{prefix or "the file"} must be fields with values')
    known = {f.name for f in fields(kind)}
    out: dict[str, Any] = {}
    for name, value in data.items():
        if name not in known:
            raise RobotProgramError(
                f'{prefix}{name}: there is no such field; known: {", ".join(sorted(known))}'
            )
        if kind is RobotCell and name in _PARTS:
            part = _PARTS[name]
            out[name] = part(**_given(part, value, f'{name}: '))
        else:
            out[name] = tuple(value) if isinstance(value, list) else value
    return out
