"""Requests to the job sequencer: adjusting the running job, resuming a job, feedback to the client."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rclpy.action.server import ServerGoalHandle

from waam_msgs.action import RunJob
from waam_msgs.msg import JobStatus
from waam_msgs.srv import AdjustJob
from waam_node import job_folder
from waam_node.conversions import to_msg

from .. import conversions as convert
from ..model.goal import Checked, Code, JobError, JobGoal, check
from ..model.limits import K_GAIN_MAX
from ..model.records import State, Status
from ..run.control import Control
from ..store.cell_file import keep as keep_cell
from ..store.folder import JobFolder
from ..store.program import keep_program
from ..store.provenance import provenance
from ..store.trace import sha256_of
from .ros_cell import RosCell


def adjust(control: Control, code: int, value: float, k_gain_max: float = K_GAIN_MAX) -> str:
    """Passes a request of the operator on. Returns what is wrong with it, '' when it was accepted."""
    requests = {AdjustJob.Request.RESCAN: 'rescan', AdjustJob.Request.SKIP_LAYER: 'skip_layer'}
    if code in requests:
        control.request(requests[code])
        return ''
    if code != AdjustJob.Request.SET_K_GAIN:
        return f'code {code} is unknown'
    if not (math.isnan(value) or 0.0 <= value <= K_GAIN_MAX):
        return f'k_gain is {value:g}, must be 0 to {K_GAIN_MAX:g} or NaN'
    if value > k_gain_max:
        return f'k_gain is {value:g}, the correction server allows {k_gain_max:g} (k_gain_max)'
    control.set_k_gain(value)
    control.remark(f'k_gain set to {value:g} from the next layer on')
    return ''


def reopen(request: RunJob.Goal) -> tuple[JobFolder, JobGoal]:
    """The folder and the goal of an interrupted job. JobError BAD_RESUME when it cannot go on."""
    path = Path(request.resume_dir).resolve()
    folder = JobFolder.open(path)
    try:
        goal = convert.goal_from_job(folder.read_yaml(job_folder.JOB), request)
    except ValueError as e:
        raise JobError(Code.BAD_RESUME, str(e)) from None
    if goal.program is not None:  # the job's own copies: the files may have gone meanwhile
        own = path / job_folder.PROGRAM_DIALECT
        goal = replace(goal, program=path / job_folder.PROGRAM_GIVEN, dialect=str(own))
    status = folder.read_json(job_folder.STATUS) or {}
    if status.get('state') == State.DONE.name:
        raise JobError(Code.BAD_RESUME, f'{path.name} is finished; there is nothing to go on with')
    return folder, goal


def recheck(goal: JobGoal, folder: JobFolder, chuck: bool = False) -> Checked:
    """Part and material as at the start of the job; a mesh that was changed since then is refused."""
    checked = check(goal, chuck)
    before = folder.read_yaml(job_folder.JOB)
    for file, known, now in (
        (goal.part, before.get('part_sha256'), checked.part_sha256),
        (goal.program, before.get('program_sha256', ''), _program_sha256(goal)),
    ):
        if known != now:
            text = f'{file} was changed since the job began (its hash is another)'
            raise JobError(Code.BAD_RESUME, text)
    return checked


def _program_sha256(goal: JobGoal) -> str:
    return sha256_of(goal.program) if goal.program else ''


def new_folder(goal: JobGoal, checked: Checked, kept: dict) -> JobFolder:
    """The folder of a new job with its job.yaml; `kept`: parameters of this node and of the others."""
    folder = JobFolder.create(goal.jobs_dir.resolve(), goal.title)
    asked = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(goal).items()}
    facts = {'job_id': folder.job_id, 'goal': asked, 'material': asdict(checked.material), **kept}
    if file := kept.get('parameters', {}).get('cell_file'):
        facts['cell'] = keep_cell(folder, file)
    made = provenance(checked.part_sha256, keep_program(goal, folder))
    folder.write_yaml(job_folder.JOB, {**facts, **made})
    return folder


def keep_resume(folder: JobFolder, goal: JobGoal, checked: Checked, kept: dict) -> int:
    """Records who resumes the job, and with what. Returns the number of the run."""
    run = folder.next_run()
    facts = {'operator_name': goal.operator_name, 'notes': list(goal.notes), **kept}
    if file := kept.get('parameters', {}).get('cell_file'):
        facts['cell'] = keep_cell(folder, file, run)
    made = provenance(checked.part_sha256, _program_sha256(goal))
    folder.write_yaml(job_folder.resume(run), {**facts, **made})
    return run


class WithFeedback:
    """The cell, with every status also sent as feedback of the action."""

    def __init__(self, cell: RosCell, handle: ServerGoalHandle) -> None:
        self._cell, self._handle = cell, handle

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cell, name)

    def status(self, status: Status) -> None:
        """Publishes the status and sends it to the client of the action."""
        self._cell.status(status)
        feedback = RunJob.Feedback()
        feedback.status = to_msg(
            JobStatus, status, stamp=self._cell.node.get_clock().now().to_msg()
        )
        self._handle.publish_feedback(feedback)
