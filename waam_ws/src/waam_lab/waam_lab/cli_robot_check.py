"""`waam plan --machine robot`: the check of a plan on the screen."""

from __future__ import annotations

import math
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from waam_plan.plan import Plan
from waam_robot_bridge.params import RobotParams

from . import params
from .robot import urdf_settings
from .robot.robot_check import check


def check_robot(plan: Plan, urdf: Path | None = None) -> None:
    """Prints what the robot, with the arm of a URDF where one is given, will make of the plan. ValueError where it must
    not be run, and for a file that cannot be used."""
    wanted: params.Overrides = {'robot_bridge': {'tilt': math.radians(plan.settings.tilt_deg)}}
    if urdf is not None:
        wanted = urdf_settings.settings(urdf, wanted)
    robot: RobotParams = params.make(wanted).robot_bridge
    console = Console(stderr=True, highlight=False)
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task('robot, layer by layer', total=len(plan.layers))
        found = check(plan, robot, lambda layer: progress.advance(task))
    for line in found.lines():
        print(line)
    if found.refused:
        raise ValueError(f'not on this robot: {found.refused}')
