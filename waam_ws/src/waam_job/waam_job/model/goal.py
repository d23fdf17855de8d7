"""What a job is asked for, checked before anything moves: all problems at once, each with its code."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from waam_plan import finish
from waam_plan.import_gcode import place
from waam_plan.import_gcode.dialect import DialectError
from waam_plan.import_gcode.files import load_program
from waam_plan.import_gcode.layers import layers_of, moved
from waam_plan.import_gcode.motion import Program
from waam_plan.import_gcode.regime import regime_problems
from waam_plan.import_gcode.words import ProgramError
from waam_plan.mesh.part import Part, PartError, load_part
from waam_plan.mesh.placed import TABLE_CELL, TABLE_MARGIN, Table, on_table
from waam_plan.settings import STRATEGIES, PlanSettings, SettingsError, assigned
from waam_plan.shaft import surfaces
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.materials import Material, MaterialError, get
from waam_process.segment import Point
from waam_process.unrolled import ShaftError, Unrolled

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
    BAD_PROGRAM = 114


class JobError(RuntimeError):
    """Ends a job: a code of the action and a text that says what and where."""

    def __init__(self, code: Code, text: str) -> None:
        super().__init__(text)
        self.code = code

    def __reduce__(self) -> tuple[type[JobError], tuple[Code, str]]:
        """Workers of a pool hand it on with its code."""
        return JobError, (self.code, str(self))


MODES = ('restore', 'build')
NO_CHUCK = (
    'a shaft (shaft_diameter) turns in a chuck in place of the X axis, and this cell has none: it would lay it flat. '
    'The file of a cell that has one says chuck.steps_per_turn (docs/real_cell.md); a robot has none'
)
CHUCK_ONLY = (
    'the X axis of this cell is a chuck (chuck.steps_per_turn of its file), which turns shafts (--shaft, --ends); a '
    'part that lies still needs a cell with a straight X axis'
)
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

    part: Path  # mesh of the nominal part; with a program it may be missing: Path('')
    material: str  # key of the material table
    jobs_dir: Path  # where the job's folder is made
    name: str = ''  # short name; '' = that of the part
    mode: str = 'restore'  # of MODES
    loop_mode: str = LoopMode.CLOSED_LOOP.value  # of LOOP_MODES
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
    program: Path | None = None  # G-code that is laid as it is; None = the part is planned
    dialect: str = ''  # what its codes mean: a shipped name or a YAML file; '' = our own programs
    program_shift: Point = (0.0, 0.0, 0.0)  # m, added to its coordinates

    @property
    def title(self) -> str:
        """The name that was given, or that of the file that is laid."""
        return self.name or self.file.stem

    @property
    def file(self) -> Path:
        """What is laid: the program, else the part."""
        return self.program or self.part

    @property
    def shaft_diameter(self) -> float:
        """m, nominal, of a shaft that turns; 0 for a part that lies still, and where the settings are wrong."""
        try:
            given = assigned(self.plan_settings, GIVEN).get('shaft_diameter', 0.0)
        except SettingsError:  # told by `field_problems`
            return 0.0
        return given if isinstance(given, float) else 0.0

    @property
    def has_part(self) -> bool:
        """Whether there is a nominal part; only a program can do without."""
        return bool(self.part.name)


def planner_fields(goal: JobGoal, material: Material) -> dict[str, Any]:
    """Fields of PlanSettings that goal and material decide. Raises SettingsError."""
    own = assigned(goal.plan_settings, GIVEN)
    usual = finish.bead_width(material.bead_width, str(own.get('finish', '')))
    return {
        'layer_height': goal.layer_height or material.layer_height,
        'bead_width': goal.bead_width or usual,
        'speed': material.speed,
        'allowance': goal.allowance,
        'tolerance': goal.tolerance,
        'pitch_ratio': material.overlap,
        'strategy': goal.strategy or PlanSettings.strategy,
        'wire_diameter': material.wire_diameter,
        'efficiency': material.efficiency,
        'voltage': material.voltage,
        'arc_efficiency': material.arc_efficiency,
        **own,
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
    if goal.loop_mode not in LOOP_MODES:
        problems.append(
            f"loop mode '{goal.loop_mode}' is unknown; known are {', '.join(LOOP_MODES)}"
        )
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
    problems += _program_problems(goal)
    try:
        own = assigned(goal.plan_settings, GIVEN)
        if own.get('finish') == finish.MACHINED and (goal.mode == 'build' or goal.program):
            problems.append('finish machined belongs to a part that is restored')
    except SettingsError as e:
        problems.append(str(e))
    return [p for p in problems if p]


def _program_problems(goal: JobGoal) -> list[str]:
    """Fields that do not go together with a program, or only with one."""
    if goal.program is None:
        alone = [] if goal.has_part else ['part: no file is given']
        if goal.dialect or any(goal.program_shift):
            alone.append('dialect and program_shift belong to a program')
        return alone
    wrong = []
    if goal.strategy or goal.allowance or goal.passes > 1:
        wrong.append(
            'strategy, allowance and passes belong to a part that is planned, not to a program'
        )
    if goal.loop_mode == LoopMode.CLOSED_LOOP.value and not goal.has_part:
        wrong.append('loop mode closed_loop needs a nominal part (--nominal); without it: monitor')
    if not all(math.isfinite(v) and abs(v) <= 1.0 for v in goal.program_shift):
        wrong.append(f'program_shift is {goal.program_shift} m, must be within 1 m')
    return wrong


def _contradictions(goal: JobGoal, material: Material) -> list[str]:
    """Between what the goal asks of the planner and the material."""
    try:
        PlanSettings(**planner_fields(goal, material))
    except SettingsError as e:
        return [str(e)]
    return []


@dataclass(frozen=True)
class Checked:
    """A goal that passed the check, with what was read for it."""

    goal: JobGoal
    part: Part | None  # tilted as the goal says; None only with a program
    material: Material
    program: Program | None = None  # already shifted; None = the part is planned
    offset: Point = (0.0, 0.0, 0.0)  # added to the part's coordinates, m
    box: np.ndarray | None = None  # (2, 3) m, work frame: what is scanned
    remarks: tuple[str, ...] = ()  # of program and part
    in_file: Part | None = None  # the part as its file has it

    @property
    def part_sha256(self) -> str:
        """Of the mesh; '' without one."""
        return self.part.sha256 if self.part else ''

    def on_table(self, worn: Path, cell: float = TABLE_CELL, margin: float = TABLE_MARGIN) -> Table:
        """The worn part of a restoration as it lies in a simulated cell (`waam_plan.mesh.placed`), its file in the
        coordinates and units of the nominal part. ValueError where the two do not fit each other."""
        if shaft := self.shaft:
            return Table(surfaces.table_of(worn, self.goal.scale, shaft, cell, margin))
        settings = PlanSettings(**planner_fields(self.goal, self.material))
        placed = self.offset if self.program is not None else None
        return on_table(self.in_file, worn, self.goal.scale, settings, cell, margin, placed)

    @property
    def shaft(self) -> Unrolled | None:
        """The shaft that turns in place of the X axis; None for a part that lies still."""
        return PlanSettings(**planner_fields(self.goal, self.material)).unrolled

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) m, work frame: the box that is scanned, for a planned part its own with the lower corner at zero."""
        if self.box is not None:
            return self.box
        assert self.part is not None  # of a job that plans
        return self.part.bounds - self.part.bounds[0]


def check(goal: JobGoal, chuck: bool = False) -> Checked:
    """Reads part, program and material. Raises JobError that names everything that is wrong.

    chuck: whether the cell turns a shaft in place of its X axis. Only there a shaft is laid, and nothing else.
    """
    problems = [(Code.BAD_GOAL, p) for p in field_problems(goal)]
    shaft = None
    try:
        shaft = Unrolled(goal.shaft_diameter) if goal.shaft_diameter else None
    except ShaftError as e:
        problems.append((Code.BAD_GOAL, str(e)))
    if shaft and not chuck:
        problems.append((Code.BAD_GOAL, NO_CHUCK))
    if chuck and not shaft and not problems:
        problems.append((Code.BAD_GOAL, CHUCK_ONLY))
    if shaft and (goal.mode == 'build' or goal.program):
        problems.append((Code.BAD_GOAL, 'shaft_diameter belongs to a shaft that is restored'))
    part = program = material = None
    try:
        if goal.has_part and shaft:
            part = surfaces.part_of(goal.part, goal.scale, shaft)
        elif goal.has_part:
            closed = goal.mode == 'build' and goal.strategy != 'shell' and goal.program is None
            part = load_part(goal.part, goal.scale, closed, goal.repair, look_for_crossings=True)
    except (PartError, ShaftError) as e:
        problems.append((Code.BAD_PART, str(e)))
    try:
        material = get(goal.material)
    except MaterialError as e:
        problems.append((Code.UNKNOWN_MATERIAL, str(e)))
    try:
        program = _program(goal)
    except (ProgramError, DialectError) as e:
        problems.append((Code.BAD_PROGRAM, str(e)))
    if material and program:
        problems += [(Code.BAD_PROGRAM, p) for p in regime_problems(program, material)]
    if material and not problems:
        problems += [(Code.BAD_GOAL, p) for p in _contradictions(goal, material)]
    if problems or material is None:
        raise JobError(problems[0][0], '; '.join(text for _, text in problems))
    in_file = part
    if part is not None:
        part = part.tilted(PlanSettings(**planner_fields(goal, material)).tilt_deg)
    return _placed(Checked(goal, part, material, program, in_file=in_file))


def _program(goal: JobGoal) -> Program | None:
    """Read, shifted, and with layers that can be told apart. Raises ProgramError or DialectError."""
    if goal.program is None:
        return None
    program = moved(load_program(goal.program, goal.dialect), goal.program_shift)
    layers_of(program)
    return program


def _placed(checked: Checked) -> Checked:
    """With the places of part and program in the work frame."""
    part, program, goal = checked.part, checked.program, checked.goal
    if program is None:
        assert part is not None
        x, y, z = (-float(v) for v in part.bounds[0])
        return replace(checked, offset=(x, y, z), remarks=part.report.notes)
    path = place.path_box(program)
    half = planner_fields(goal, checked.material)['bead_width'] / 2
    box = path + [[-half, -half, 0.0], [half, half, 0.0]]
    box[0, 2] = 0.0
    if part is None:
        return replace(checked, box=box)
    offset, how = place.part_offset(part.bounds, path)
    lies = part.bounds + offset
    if goal.mode == 'restore':
        box = np.array([np.minimum(box[0], lies[0]), np.maximum(box[1], lies[1])])
    return replace(checked, offset=offset, box=box, remarks=(how, *part.report.notes))
