"""`waam plan --machine robot`: the check of a plan on the screen."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from rich.console import Console
from rich.progress import Progress

from waam_plan.plan import Plan
from waam_robot.turn_choice import choose
from waam_robot_bridge.params import RobotParams

from . import params
from .robot import urdf_settings
from .robot.dry_run import work_zero
from .robot.robot_check import check

PARAMETERS = 'robot.yaml'


def check_robot(
    plan: Plan, urdf: Path | None = None, turning: bool = False, out: Path | None = None
) -> None:
    """Prints what the robot, with the arm of a URDF where one is given, will make of the plan. turning: the positioner
    turns the part as is best, and PARAMETERS in `out` says how. ValueError where the plan must not be run, and for a
    file that cannot be used."""
    wanted: params.Overrides = {'robot_bridge': {'tilt': math.radians(plan.settings.tilt_deg)}}
    if urdf is not None:
        wanted = urdf_settings.settings(urdf, wanted)
    robot: RobotParams = params.make(wanted).robot_bridge
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
        values = {'bridge': {'turning': list(turning)}, 'cell': {'robot_turning': list(turning)}}
        text = yaml.safe_dump({node: {'ros__parameters': v} for node, v in values.items()})
        (out / PARAMETERS).write_text(text)
        print(f'robot: {out / PARAMETERS} has it for `waam up --machine robot --params-file`')
    return replace(robot, turning=turning)
