"""Forecasts of jobs (`waam forecast`) beside the jobs: the report of a job finds the one that was made of it.

They lie in jobs/forecasts/KEY. The key is made of everything that the goal decides. The worn part does not belong to
the goal: whether a forecast is of this wear is told by the volume that is planned.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

from waam_node import job_folder
from waam_node.files import write_atomically
from waam_process.safe_files import FileError, Missing, read_bytes, read_mapping

from ..model.goal import Checked, planner_fields

FILE = 'forecast.json'
SAME_VOLUME = 0.1  # of the planned volume: more apart is another wear


def folder_of(checked: Checked) -> Path:
    """Where the forecast of this goal lies."""
    goal = checked.goal
    fields = planner_fields(goal, checked.material)
    program = read_bytes(goal.program) if goal.program else b''
    asked = (
        checked.part_sha256,
        hashlib.sha256(program).hexdigest(),
        *(goal.dialect, goal.program_shift, goal.material, goal.mode, str(goal.loop_mode)),
        *(goal.layers, goal.passes, str(goal.k_gain)),
        *((k, _rounded(fields[k])) for k in sorted(fields)),
    )
    key = hashlib.sha256(repr(asked).encode()).hexdigest()[:16]
    return goal.jobs_dir / job_folder.FORECASTS / key


def _rounded(value: Any) -> Any:
    """The same whatever unit it was entered in."""
    return float(f'{value:.6g}') if isinstance(value, float) else value


def write(folder: Path, text: str) -> None:
    """Replaces the forecast in an existing folder."""
    write_atomically(folder / FILE, text)


def find(checked: Checked, volume: float) -> tuple[dict[str, Any] | None, str]:
    """The forecast of this goal for a plan of so much metal (m3), and why there is none although a file is there."""
    try:
        found = read_mapping(folder_of(checked) / FILE)  # also where the program is gone by now
    except Missing:
        return None, ''
    except FileError as e:
        return None, f'the forecast cannot be read: {e}'
    planned = found.get('volume_cm3')
    if not isinstance(planned, int | float) or not math.isclose(
        volume * 1e6, planned, rel_tol=SAME_VOLUME
    ):
        lays = f'{volume * 1e6:.1f} cm3'
        return (
            None,
            f'the forecast is of another wear: {planned} cm3 of metal, this plan lays {lays}',
        )
    return found, ''
