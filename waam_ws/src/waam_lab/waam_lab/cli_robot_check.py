"""`waam plan --machine robot`: the check of a plan on the screen."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.progress import Progress

from waam_plan.plan import Plan
from waam_robot.turn_choice import choose
from waam_robot_bridge.params import NAMES, RobotParams

from . import params
from .robot import urdf_settings
from .robot.dry_run import work_zero
from .robot.robot_check import check

PARAMETERS, CELL = 'robot.yaml', 'cell.yaml'


def check_robot(
    plan: Plan,
    urdf: Path | None = None,
    turning: bool = False,
    out: Path | None = None,
    files: Sequence[Path] = (),
) -> None:
    """Prints what the robot, with the arm of a URDF where one is given, will make of the plan. ValueError where the
    plan must not be run, and for a file that cannot be used.

    turning: the positioner turns the part as is best; PARAMETERS (of nodes) and CELL (of programs) in `out` say how.
    files: ROS parameter files, of which those of the bridge count.
    """
    given: dict[str, Any] = {}
    for file in files:
        blocks = params.read_file(file)
        values = params.of_node(blocks, 'bridge')
        if not values and (meant := difflib.get_close_matches('bridge', blocks, 1)):
            raise ValueError(f"--params-file {file}: no node '{meant[0]}'; did you mean 'bridge'?")
        given |= values
    tilt = {'tilt': math.radians(plan.settings.tilt_deg)}
    wanted: params.Overrides = {'robot_bridge': {**tilt, **given}}
    if urdf is not None:
        wanted = urdf_settings.settings(urdf, wanted)
    robot: RobotParams = params.make(wanted).robot_bridge
    if urdf is None and not robot.urdf:
        _check_names(robot.joint_names)
    if turning:
        robot = _turned(plan, robot, out)
    console = Console(stderr=True, highlight=False)
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task('robot, layer by layer', total=len(plan.layers))
        found = check(plan, robot, lambda layer: progress.advance(task))
    for line in found.lines():
        print(line)
    if found.refused:
        raise ValueError(f'not on this robot: {found.refused}')


def _check_names(names: Sequence[str]) -> None:
    """ValueError for a joint that the M-20iB/25 does not have."""
    for name in names:
        if name not in NAMES:
            raise ValueError(
                f"parameter 'joint_names': the robot has no joint '{name}'; there are {', '.join(NAMES)}. Those of "
                'another arm need --urdf, names that only its driver uses a parameter file for `waam up` alone'
            )


def _turned(plan: Plan, robot: RobotParams, out: Path | None) -> RobotParams:
    """The robot with the best turning for the plan, which is told. StationError where none serves."""
    points = np.array(
        [p for layer in plan.layers for s in layer.deposits for p in (s.start, s.end)]
    )
    points = points + work_zero(plan)
    high = points.max(axis=0)
    found = choose(robot.place(), points.min(axis=0), high + [0.0, 0.0, plan.settings.clearance])
    print(f'robot: {found.text}')
    turning = (found.turning.start, *found.turning.along)
    if out is not None:
        _write(out, turning, robot, work_zero(plan))
    return replace(robot, turning=turning)


def _write(
    out: Path,
    turning: tuple[float, float, float],
    robot: RobotParams,
    zero: tuple[float, float, float],
) -> None:
    """The turning for a graph and for programs. zero: m, work zero in machine coordinates."""
    place = robot.place()
    box = {'origin': list(place.origin), 'work_high': list(place.high), 'turning': list(turning)}
    values = {'bridge': box, 'cell': {f'robot_{name}': list(v) for name, v in box.items()}}
    text = yaml.safe_dump({node: {'ros__parameters': v} for node, v in values.items()})
    (out / PARAMETERS).write_text(text)
    (out / CELL).write_text(yaml.safe_dump(_cell(turning, robot, zero)))
    print(f'robot: {out / PARAMETERS} has it for `waam up --machine robot --params-file`')
    print(f'robot: {out / CELL} has it for `waam plan --post fanuc | kuka | abb --robot-cell`')


def _cell(
    turning: tuple[float, float, float], robot: RobotParams, zero: tuple[float, float, float]
) -> dict[str, object]:
    """Fields of `waam_plan.robot.cell.RobotCell`."""
    start, *along = turning
    place = robot.place()
    start += float(np.dot(along, (np.array(zero) - place.middle)[:2]))
    found: dict[str, object] = {'origin': np.add(place.origin, zero).tolist(), 'positioner': 'hold'}
    if any(turning):
        x, y = np.degrees(along).tolist()
        found |= {'positioner': 'place', 'turning': [math.degrees(start), x * 1e-3, y * 1e-3]}
    return found
