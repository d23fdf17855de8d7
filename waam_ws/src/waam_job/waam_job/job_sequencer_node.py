"""Node job_sequencer: action run_job; services pause, resume, abort, adjust. One job at a time, in its own thread."""

from __future__ import annotations

import math
import os
import threading
import traceback
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from std_srvs.srv import Trigger

from waam_msgs.action import RunJob
from waam_msgs.msg import Override
from waam_msgs.srv import AdjustJob
from waam_node.files import write_atomically
from waam_node.node import ERROR, OK, WaamNode
from waam_node.node import main as run_main
from waam_node.qos import NEWEST

from . import conversions as convert
from .model.goal import Checked, Code, JobError, check
from .model.limits import k_gain_limit
from .model.records import State, Status
from .ros.job_params import JobParams, settings_of
from .ros.node_action import ThreadedActionServer
from .ros.node_requests import WithFeedback, adjust, keep_resume, new_folder, recheck, reopen
from .ros.ros_cell import RosCell
from .run import readiness
from .run.control import Control
from .run.runner import JobRunner
from .store.folder import JobFolder


class JobSequencer(WaamNode):
    """Accepts one goal at a time and refuses a second one. Everything about a job is in its result and its folder."""

    def __init__(self) -> None:
        super().__init__('job_sequencer', JobParams)
        self.cell = RosCell(self, self.params.service_timeout)
        self.control = Control()  # of the newest job
        self.settings = settings_of(self.params, self.get_parameter('use_sim_time').value)
        self._lock = threading.Lock()
        self._busy = False
        self._server = ThreadedActionServer(
            self,
            RunJob,
            '~/run_job',
            work=self._work,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        for name in ('pause', 'resume', 'abort'):
            self.create_service(Trigger, f'~/{name}', getattr(self, f'_on_{name}'))
        self.create_service(AdjustJob, '~/adjust', self._on_adjust)
        self.create_subscription(Override, 'override', self._on_override, NEWEST)
        self.cell.status(Status())

    # ---- operator ------------------------------------------------------------------------------

    def _on_goal(self, _goal: RunJob.Goal) -> GoalResponse:
        with self._lock:
            if self._busy:
                self.get_logger().warning('a job is running; the second goal is refused')
                return GoalResponse.REJECT
            self._busy = True
            self.control = Control(self.control.factors)
        return GoalResponse.ACCEPT

    def _on_cancel(self, _handle: ServerGoalHandle) -> CancelResponse:
        self.control.abort('cancelled by the client')
        return CancelResponse.ACCEPT

    def _switch(self, response: Trigger.Response, action: str, *args: str) -> Trigger.Response:
        with self._lock:
            running = self._busy
        if running:
            getattr(self.control, action)(*args)
        response.success, response.message = running, '' if running else 'no job is running'
        return response

    def _on_pause(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._switch(response, 'pause')

    def _on_resume(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._switch(response, 'resume')

    def _on_abort(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._switch(response, 'abort', 'aborted by the operator')

    def _on_adjust(
        self, request: AdjustJob.Request, response: AdjustJob.Response
    ) -> AdjustJob.Response:
        with self._lock:
            control = self.control if self._busy else None
        if control is None:
            response.message = 'no job is running'
            return response
        limit = k_gain_limit(self.cell.parameters())  # beyond it a correction server ends the job
        response.message = adjust(control, request.code, request.value, limit)
        response.success = not response.message
        return response

    def _on_override(self, message: Override) -> None:
        """The bridge acts on it; the job only records it."""
        with self._lock:
            self.control.override(message.speed_factor, message.wire_factor)
            control = self.control if self._busy else None
        if control is not None:
            who = message.source or 'unknown'
            control.remark(
                f'override by {who}: speed {message.speed_factor:g}, wire {message.wire_factor:g}'
            )

    # ---- the job -------------------------------------------------------------------------------

    def _work(self, handle: ServerGoalHandle) -> RunJob.Result:
        """Runs the goal from start to end, in a thread of its own."""
        result = RunJob.Result()
        try:
            self._run(handle, result)
        except Exception as e:
            traceback.print_exc()
            result.error_code, result.message = int(Code.UNKNOWN), f'{type(e).__name__}: {e}'
            self.cell.status(
                Status(state=State.FAILED, error_code=result.error_code, message=result.message)
            )
        self.level, self.message = (ERROR, result.message) if result.error_code else (OK, 'ok')
        if result.error_code == int(Code.ABORTED) and handle.is_cancel_requested:
            handle.canceled()
        elif result.error_code:
            handle.abort()
        else:
            handle.succeed()
        with self._lock:
            self._busy = False
        return result

    def _run(self, handle: ServerGoalHandle, result: RunJob.Result) -> None:
        self.cell.status(Status(state=State.VALIDATING, loop_mode=handle.request.loop_mode))
        try:
            checked, folder, run = self._accept(handle.request)
        except JobError as e:
            result.error_code, result.message = int(e.code), str(e)
            self.cell.status(Status(state=State.FAILED, error_code=int(e.code), message=str(e)))
            return
        cell = WithFeedback(self.cell, handle)
        runner = JobRunner(cell, checked, folder, self.control, self.settings, run)
        status = runner.run()
        result.error_code, result.message = status.error_code, status.message
        result.job_id, result.job_dir = folder.job_id, str(folder.path)
        result.layers, result.in_tolerance = status.layers, runner.in_tolerance
        result.rms = runner.final.rms if runner.final else math.nan
        result.max_error = runner.final.max if runner.final else math.nan

    def _accept(self, request: RunJob.Goal) -> tuple[Checked, JobFolder, int]:
        """A new folder, or that of the job to resume. Raises JobError with everything that is wrong."""
        self.cell.read_parameters()
        kept = {'parameters': asdict(self.params), 'nodes': self.cell.parameters()}
        chuck = self.settings.chuck_steps_per_turn > 0
        if request.resume_dir:
            folder, goal = reopen(request)
            checked = self._with_all_that_is_wrong(lambda: recheck(goal, folder, chuck))
            run = keep_resume(folder, goal, checked, kept)
        else:
            goal, run = convert.goal_from_msg(request, self.params.jobs_dir), 1
            checked = self._with_all_that_is_wrong(lambda: check(goal, chuck))
            folder = new_folder(goal, checked, kept)
        if self.params.job_pointer:
            write_atomically(Path(self.params.job_pointer), str(folder.path))
        return checked, folder, run

    def _with_all_that_is_wrong(self, check: Callable[[], Checked]) -> Checked:
        """Adds the faults of the cell to those of a refused goal; with a valid goal it gives the cell some seconds."""
        try:
            return check()
        except JobError as e:
            wrong = readiness.problems(self.cell, self.settings)
            raise JobError(e.code, '; '.join([str(e), *wrong])) from None


def main() -> None:
    """The node as a process; OMP_NUM_THREADS is 1 unless the environment says otherwise."""
    os.environ.setdefault('OMP_NUM_THREADS', '1')
    run_main(JobSequencer)
