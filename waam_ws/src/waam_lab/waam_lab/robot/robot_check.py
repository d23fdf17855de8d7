"""A plan on the robot before the arc: reach, contacts, and where the torch will not have the programmed speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from waam_node.params import ParameterError
from waam_plan.plan import Plan
from waam_robot.station import StationError
from waam_robot_bridge.foresee import END, SPEED_TOLERANCE, START, Place, asked, places
from waam_robot_bridge.pace import Pacer
from waam_robot_bridge.params import RobotParams
from waam_robot_bridge.station_file import station_of

from .contacts import contacts
from .dry_run import DryRunError, layers, work_zero

MAX_LINES = 20


@dataclass(frozen=True)
class RobotCheck:
    """length: m with the arc on. ends: m at starts and ends together, and the longest of them; off: places between
    them; contacts: one line each; problem: why the plan cannot be run at all; unchecked: why contacts were not looked
    for; left_out: links that they were not looked for with; used: (3, n) largest shares of the limits of the joints
    `names`; timed_by: `waam_robot_bridge.pace.Pacer.by`."""

    length: float
    ends: tuple[float, float] = (0.0, 0.0)
    off: tuple[Place, ...] = ()
    contacts: tuple[str, ...] = ()
    problem: str = ''
    unchecked: str = ''
    used: np.ndarray | None = None
    names: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    timed_by: str = ''

    @property
    def refused(self) -> str:
        """Why the plan must not be run on the robot; '' = it may."""
        stopping = next((p.text for p in self.off if p.stops), '')
        return self.problem or next(iter(self.contacts), '') or stopping

    def lines(self) -> list[str]:
        """What people are told."""
        if self.problem:
            return [f'robot: {self.problem}']
        share = 1 - (self.ends[0] + sum(p.end - p.begin for p in self.off)) / max(self.length, 1e-9)
        out = [
            f'robot: the torch has the programmed speed within {SPEED_TOLERANCE:.0%} on {share:.2%} of '
            f'{self.length:.2f} m; starts and ends take {self.ends[1] * 1e3:.1f} mm at most'
        ]
        out += _some([f'  {p.text}' for p in self.off], 'places')
        if self.used is not None:
            out.append(
                f'robot: {_drives(self.used, self.names)}; where one is too weak, segments are timed by {self.timed_by}'
            )
        out += _some([f'contact: {text}' for text in self.contacts], 'contacts')
        if self.unchecked:
            out.append(f'warning: contacts were not looked for: {self.unchecked}')
        elif not self.contacts:
            out.append(
                'robot: arm, torch, part and positioner keep their distance, ways between beads included'
            )
        if self.left_out:
            out.append(f'warning: left out, because they are meshes: {", ".join(self.left_out)}')
        return out


def check(
    plan: Plan, params: RobotParams, told: Callable[[int], None] = lambda layer: None
) -> RobotCheck:
    """The plan, with its reach as that of the machine, on the robot of the parameters. `told` after every layer."""
    length = sum(layer.length for layer in plan.layers)
    stands = float(np.degrees(params.tilt))
    if abs(stands - plan.settings.tilt_deg) > 1e-3:
        text = f'the plan is for a tilt of {plan.settings.tilt_deg:g} deg, the positioner stands at {stands:g}'
        return RobotCheck(length, problem=text)
    found: list[Place] = []
    names = params.limits_of_joints().names
    used = np.zeros((3, len(names)))
    try:
        station = station_of(params)
        for laid in layers(plan, params, told, station):
            found += [p for bead in laid.beads for p in places(bead, station, params)]
            drives = asked(laid.tips, station, params)
            used = np.maximum(used, drives.most)
            said = drives.too_much(laid.tips, work_zero(plan, station))
            if said and not any(p.stops for p in found):
                return RobotCheck(length, problem=f'layer {laid.number}, {said}')
        touching = contacts(plan, station)
    except (StationError, DryRunError, ParameterError) as e:
        return RobotCheck(length, problem=str(e))
    ends = [p.end - p.begin for p in found if p.cause in (START, END)]
    off = tuple(p for p in found if p.cause not in (START, END))
    longest = (sum(ends), max(ends, default=0.0))
    return RobotCheck(
        length, longest, off, touching.found, unchecked=touching.unchecked, used=used,
        names=names, left_out=touching.left_out, timed_by=Pacer(station, params).by,
    )  # fmt: skip


def _some(lines: list[str], what: str) -> list[str]:
    rest = len(lines) - MAX_LINES
    return lines[:MAX_LINES] + ([f'  ... and {rest} more {what}'] if rest > 0 else [])


def _drives(used: np.ndarray, names: tuple[str, ...]) -> str:
    """How much of their limits the joints use."""
    shares = [
        f'{row.max():.0%} of the {what} ({names[int(row.argmax())]})'
        for what, row in zip(('speed', 'acceleration', 'jerk'), used, strict=True)
    ]
    return f'its joints use at most {shares[0]}, {shares[1]} and {shares[2]} that they may have'
