"""Where the part lies in the machine, and what the planner may use of it. Pure."""

from __future__ import annotations

from typing import Any

from waam_plan.settings import PlanSettings
from waam_process.segment import Point

from ..model.cell import Machine
from ..model.goal import Checked, JobGoal, planner_fields
from .settings import Settings

HALF_A_STEP = 2e-5  # m, of the coarsest motor


def minus(a: Point, b: Point) -> Point:
    """Component by component."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def work_zero(goal: JobGoal, settings: Settings) -> Point:
    """Machine coordinates of the part's lower corner: the clamp's zero, or inside and on top of the plate."""
    zero, plate = settings.work_offset, settings.plate_zero
    if goal.mode == 'restore':
        return zero
    return zero[0] + plate[0], zero[1] + plate[1], zero[2] + plate[2]


def reach_known(machine: Machine) -> bool:
    """Whether the controller has said how far the machine reaches."""
    pairs = zip(machine.limit_min, machine.limit_max, strict=True)
    return all(low < high for low, high in pairs)


def reached(machine: Machine, zero: Point) -> Point:
    """Where the torch is, m, work frame, for a plan that stays within the limits: a homed axis stands on a whole step,
    which may be half a one beyond them. Farther outside, it is where it is."""
    if not reach_known(machine):
        return machine.position
    ends = minus(machine.limit_min, zero), minus(machine.limit_max, zero)
    inside = [min(max(p, low), high) for p, low, high in zip(machine.position, *ends, strict=True)]
    x, y, z = (
        i if abs(i - p) < HALF_A_STEP else p for i, p in zip(inside, machine.position, strict=True)
    )
    return x, y, z


def plan_settings(checked: Checked, settings: Settings, machine: Machine) -> PlanSettings:
    """What the planner needs of goal, material and machine."""
    zero = work_zero(checked.goal, settings)
    fields: dict[str, Any] = {
        'machine_min': minus(machine.limit_min, zero),
        'machine_max': minus(machine.limit_max, zero),
        'grid': settings.resolution,
    }
    return PlanSettings(**fields | planner_fields(checked.goal, checked.material))
