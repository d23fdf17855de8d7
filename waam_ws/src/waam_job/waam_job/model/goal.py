"""What a job is asked for, checked before anything moves: all problems at once, each with its code."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from waam_plan.mesh.part import Part, PartError, load_part
from waam_plan.settings import STRATEGIES, PlanSettings, SettingsError, assigned
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.materials import Material, MaterialError, get

from .limits import K_GAIN_MAX


class Code(IntEnum):
    """Error codes of the run_job action (waam_msgs/action/RunJob)."""

    NONE = 0
    UNKNOWN = 100
    BUSY = 101
    BAD_GOAL = 102
    BAD_PART = 103
    UNKNOWN_MATERIAL = 104
    MACHINE_NOT_READY = 105
    PLAN_FAILED = 106
    SCAN_FAILED = 107
    DEPOSITION_FAILED = 108
    NODE_LOST = 109
    LINK_LOST = 110
    ABORTED = 111
    TIMEOUT = 112
    BAD_RESUME = 113


class JobError(RuntimeError):
    """Ends a job: a code of the action and a text that says what and where."""

    def __init__(self, code: Code, text: str) -> None:
        super().__init__(text)
        self.code = code


MODES = ('restore', 'build')
# planner settings that have a field of their own in the goal, or that follow from machine and map
GIVEN = {
    'layer_height',
    'bead_width',
    'strategy',
    'allowance',
    'tolerance',
    'machine_min',
    'machine_max',
    'grid',
}


@dataclass(frozen=True)
class JobGoal:
    """The goal of run_job in SI, with its defaults. Fields are named as in the message and in job.yaml."""

    part: Path  # mesh of the nominal part
    material: str  # key of the material table
    jobs_dir: Path  # where the job's folder is made
    name: str = ''  # short name; '' = that of the part
    mode: str = 'restore'  # of MODES
    profile: str = LoopMode.CLOSED_LOOP.value  # see `loop_mode`
    layers: int = 0  # at most so many; 0 = as many as needed
    layer_height: float = 0.0  # m; 0 = of the material
    bead_width: float = 0.0  # m; 0 = of the material
    k_gain: float = math.nan  # authority of the speed correction; NaN = the correction server's own
    tolerance: float = 0.2e-3  # m
    scale: float = 1e-3  # m per unit of the mesh
    operator_name: str = ''  # who answers for the job
    notes: tuple[str, ...] = ()  # 'key=value', kept with the job
    strategy: str = ''  # how layers are filled; '' = chosen by the planner
    allowance: float = 0.0  # m of metal left for machining
    passes: int = 1  # plans; the second one is made from the scan after the first
    wire_left: float = 0.0  # m on the spool; 0 = not known
    plan_settings: tuple[str, ...] = ()  # 'NAME=VALUE' of PlanSettings, SI
    repair: bool = False  # of the mesh: holes, double faces, normals
    # of what jobs have taught, by cell, material and regime; None = nothing is read and nothing kept
    learned_dir: Path | None = None
    fresh: bool = False  # starts without what former jobs have taught, and teaches nothing
    new_spool: bool = False  # wire_left was entered for this run, not for the first one

    @property
    def loop_mode(self) -> LoopMode:
        """What the message calls the profile. ValueError for an unknown one."""
        return LoopMode(self.profile)

    @property
    def title(self) -> str:
        """The name that was given, or that of the part's file."""
        return self.name or self.part.stem


def planner_fields(goal: JobGoal, material: Material) -> dict[str, Any]:
    """Fields of PlanSettings that goal and material decide. Raises SettingsError."""
    return {
        'layer_height': goal.layer_height or material.layer_height,
        'bead_width': goal.bead_width or material.bead_width,
        'speed': material.speed,
        'allowance': goal.allowance,
        'tolerance': goal.tolerance,
        'pitch_ratio': material.overlap,
        'strategy': goal.strategy or PlanSettings.strategy,
        'wire_diameter': material.wire_diameter,
        'efficiency': material.efficiency,
        'voltage': material.voltage,
        'arc_efficiency': material.arc_efficiency,
        **assigned(goal.plan_settings, GIVEN),
    }


def _in_range(
    what: str, value: float, low: float, high: float, unit: str, factor: float
) -> str | None:
    if low <= value <= high:
        return None
    return (
        f'{what} is {value * factor:g} {unit}, must be {low * factor:g} to {high * factor:g} {unit}'
    )


def field_problems(goal: JobGoal) -> list[str]:
    """Everything that is wrong with the values of a goal."""
    problems: list[str | None] = []
    if goal.profile not in LOOP_MODES:
        problems.append(f"profile '{goal.profile}' is unknown; known are {', '.join(LOOP_MODES)}")
    if goal.mode not in MODES:
        problems.append(f"mode '{goal.mode}' is unknown; known are {', '.join(MODES)}")
    if goal.layer_height:
        problems.append(_in_range('layer height', goal.layer_height, 0.5e-3, 4e-3, 'mm', 1e3))
    if goal.bead_width:
        problems.append(_in_range('bead width', goal.bead_width, 2e-3, 15e-3, 'mm', 1e3))
    if not math.isnan(goal.k_gain):
        problems.append(_in_range('k_gain', goal.k_gain, 0.0, K_GAIN_MAX, '', 1))
    problems.append(_in_range('tolerance', goal.tolerance, 0.02e-3, 5e-3, 'mm', 1e3))
    problems.append(_in_range('scale', goal.scale, 1e-6, 1.0, 'm per unit', 1))
    if goal.strategy and goal.strategy not in STRATEGIES:
        problems.append(f"strategy '{goal.strategy}' is unknown; known are {', '.join(STRATEGIES)}")
    problems.append(_in_range('allowance', goal.allowance, -1e-3, 5e-3, 'mm', 1e3))
    problems.append(_in_range('passes', goal.passes, 1, 9, '', 1))
    problems.append(_in_range('wire left', goal.wire_left, 0.0, 1e5, 'm', 1))
    if goal.mode == 'build' and (goal.passes > 1 or goal.allowance):
        problems.append('passes and allowance belong to mode restore')
    for note in goal.notes:
        if '=' not in note:
            problems.append(f"note '{note}' is not of the form key=value")
    try:
        assigned(goal.plan_settings, GIVEN)
    except SettingsError as e:
        problems.append(str(e))
    return [p for p in problems if p]


def _contradictions(goal: JobGoal, material: Material) -> list[str]:
    """Between what the goal asks of the planner and the material."""
    try:
        PlanSettings(**planner_fields(goal, material))
    except SettingsError as e:
        return [str(e)]
    return []


@dataclass(frozen=True)
class Checked:
    """A goal that passed the check, with the part and the material that were read for it."""

    goal: JobGoal
    part: Part
    material: Material


def check(goal: JobGoal) -> Checked:
    """Reads part and material. Raises JobError that names everything that is wrong, not only the first thing."""
    problems = [(Code.BAD_GOAL, p) for p in field_problems(goal)]
    part, material = None, None
    try:
        closed = goal.mode == 'build' and goal.strategy != 'shell'
        part = load_part(goal.part, goal.scale, closed, goal.repair, look_for_crossings=True)
    except PartError as e:
        problems.append((Code.BAD_PART, str(e)))
    try:
        material = get(goal.material)
    except MaterialError as e:
        problems.append((Code.UNKNOWN_MATERIAL, str(e)))
    if material and not problems:
        problems += [(Code.BAD_GOAL, p) for p in _contradictions(goal, material)]
    if problems or part is None or material is None:
        raise JobError(problems[0][0], '; '.join(text for _, text in problems))
    return Checked(goal, part, material)
