"""The program of others that a job lays, kept in its folder: resuming, report and record need it as it was."""

from __future__ import annotations

from waam_node import job_folder
from waam_plan.import_gcode.files import DEFAULT, dialect_text

from ..model.goal import JobGoal
from .folder import JobFolder
from .trace import sha256_of


def keep_program(goal: JobGoal, folder: JobFolder) -> str:
    """Copies program and dialect into the folder. Returns the program's hash; '' when the goal has none."""
    if goal.program is None:
        return ''
    (folder.path / job_folder.PROGRAM_GIVEN).write_bytes(goal.program.read_bytes())
    folder.keep(job_folder.PROGRAM_DIALECT, dialect_text(goal.dialect or DEFAULT))
    return sha256_of(folder.path / job_folder.PROGRAM_GIVEN)
