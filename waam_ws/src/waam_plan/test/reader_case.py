"""One case of the readers: a file made here, and what is right for it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from waam_plan.import_gcode import files, plan_of
from waam_plan.import_gcode.dialect import DialectError
from waam_plan.import_gcode.words import ProgramError
from waam_plan.mesh import clouds, inputs, part
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid

NAMED = (part.PartError, ProgramError, DialectError, PlanError)


@dataclass(frozen=True)
class Case:
    """data: of the file `name`. refused: whether it must be. words: regular expressions in the message, or in the
    notes of what was read. check: of what was read, may raise AssertionError. part: nominal, of a scan (STL)."""

    about: str
    name: str
    data: Callable[[], bytes]
    words: tuple[str, ...] = ()
    refused: bool = False
    check: Callable[[Any], None] = lambda got: None
    part: Callable[[], bytes] | None = None


@dataclass(frozen=True)
class GotCloud:
    """points: (n, 3) m. low: height that became the work zero, m."""

    points: np.ndarray
    low: float


def read(case: Case, folder: Path) -> tuple[Any, str]:
    """What the reader makes of the file, and the notes for a person."""
    path = folder / case.name
    path.write_bytes(case.data())
    if files.is_program(path):
        program = files.load_program(path, 'slicer' if 'extruder' in case.name else '')
        spec = GridSpec.covering(-0.02, -0.02, 0.1, 0.08, 1e-3)
        plan = plan_of.plan_program(program, PlanSettings(), HeightGrid.full(spec, 0.0))
        return program, '\n'.join([*plan.remarks, *plan.warnings])
    if case.part is not None:
        nominal = folder / 'nominal.stl'
        nominal.write_bytes(case.part())
        got = inputs.of_part(part.load_part(nominal), path, 1e-3, PlanSettings(), False)
        return got, '\n'.join(getattr(got, 'notes', ()))
    if clouds.is_cloud(path):
        cloud = clouds.read_cloud(path)
        zone = inputs.flat(cloud, PlanSettings())
        points = getattr(cloud, 'points', cloud)
        return GotCloud(points, -zone.offset[2]), '\n'.join(getattr(cloud, 'notes', []))
    mesh = part.load_part(path)
    return mesh, '\n'.join(mesh.report.lines())


def fault(case: Case, folder: Path) -> str:
    """What is wrong with what the reader does; '' if nothing."""
    try:
        got, notes = read(case, folder)
    except NAMED as error:
        if not case.refused:
            return f'refused: {error}'
        missing = [w for w in case.words if not re.search(w, str(error), re.S)]
        return f'{missing} not in: {error}' if missing else ''
    except Exception as error:  # every other is a defect
        return f'{type(error).__name__}: {error}'
    if case.refused:
        return f'read, must be refused for {case.words}; notes: {notes}'
    missing = [w for w in case.words if not re.search(w, notes, re.S)]
    if missing:
        return f'{missing} not in the notes: {notes}'
    try:
        case.check(got)
    except AssertionError as error:
        return f'other than what the file holds: {error}'
    return ''
