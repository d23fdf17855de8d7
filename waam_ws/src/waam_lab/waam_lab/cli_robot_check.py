"""`waam plan --machine robot`: the check of a plan on the screen."""

from __future__ import annotations

import math

from rich.console import Console
from rich.progress import Progress

from waam_plan.plan import Plan
from waam_robot_bridge.params import RobotParams

from . import params
from .robot.robot_check import check


def check_robot(plan: Plan) -> None:
    """Prints what the robot will make of the plan. ValueError where it must not be run."""
    tilt = math.radians(plan.settings.tilt_deg)
    robot: RobotParams = params.make({'robot_bridge': {'tilt': tilt}}).robot_bridge
    console = Console(stderr=True, highlight=False)
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task('robot, layer by layer', total=len(plan.layers))
        found = check(plan, robot, lambda layer: progress.advance(task))
    for line in found.lines():
        print(line)
    if found.refused:
        raise ValueError(f'not on this robot: {found.refused}')
