"""Node job_sequencer: action run_job, services pause, resume, abort. One job at a time, in a thread of its own."""

from __future__ import annotations

import math
import os
import threading
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from std_srvs.srv import Trigger

from waam_msgs.action import RunJob
from waam_node.files import write_atomically
from waam_node.node import ERROR, OK, WaamNode
from waam_node.node import main as run_main
from waam_node.params import param

from . import conversions as convert
from .control import Control
from .folder import JobFolder
from .goal import Checked, Code, JobError, JobGoal, check
from .provenance import provenance
from .records import State, Status
from .ros_cell import RosCell
from .runner import JobRunner, Settings
from .watch import Limits


@dataclass(frozen=True)
class JobParams:
    """Parameters of job_sequencer."""

    lease_nodes: tuple = param(
        (), 'nodes whose heartbeat the arc lease needs; empty = only the bridge'
    )
    jobs_dir: str = param('jobs', 'folder for jobs when the goal names none')
    job_pointer: str = param('', 'file that always holds the path of the newest job; empty = none')
    work_offset: tuple = param((0.100, 0.080, 0.020), 'work zero (G54) in machine coordinates', 'm')
    plate_zero: tuple = param(
        (0.020, 0.020, 0.010),
        'mode build: work zero seen from the corner of the clamped plate',
        'm',
    )
    resolution: float = param(0.5e-3, 'edge of a map cell', 'm', 1e-4, 5e-3)
    margin: float = param(5e-3, 'map beyond the part on every side', 'm', 0.0, 0.1)
    follow_reach: float = param(
        3e-3, 'smoothing of the surface that the torch height follows', 'm', 5e-4, 2e-2
    )
    cooling_timeout: float = param(1800.0, 'longest interpass wait', 's', 1.0, 86400.0)
    share_in_tolerance: float = param(
        0.95, 'share of the interior within tolerance for a good verdict', '', 0.5, 1.0
    )
    link_timeout: float = param(
        5.0, 'steady time without telemetry that ends a job', 's', 0.5, 60.0
    )
    node_timeout: float = param(
        4.0, 'steady time of silence of a required node that ends a job', 's', 0.5, 60.0
    )
    lease_retries: int = param(3, 'holds by a late (not dead) node that are resumed', '', 0, 100)
    service_timeout: float = param(
        20.0, 'longest wait for an answer of another node', 's', 1.0, 600.0
    )


class JobSequencer(WaamNode):
    """Accepts one goal at a time; a second one is refused. The goal's whole life is in its result and in the folder."""

    def __init__(self) -> None:
        super().__init__('job_sequencer', JobParams)
        self.cell = RosCell(self, self.params.service_timeout)
        self.control: Control | None = None
        self._lock = threading.Lock()
        self._busy = False
        self._server = ActionServer(
            self,
            RunJob,
            '~/run_job',
            execute_callback=self._execute,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        for name in ('pause', 'resume', 'abort'):
            self.create_service(Trigger, f'~/{name}', getattr(self, f'_on_{name}'))
        self.cell.status(Status())

    # ---- operator ------------------------------------------------------------------------------

    def _on_goal(self, _goal: RunJob.Goal) -> GoalResponse:
        with self._lock:
            if self._busy:
                self.get_logger().warning('a job is running; the second goal is refused')
                return GoalResponse.REJECT
            self._busy = True
            self.control = Control()
        return GoalResponse.ACCEPT

    def _on_cancel(self, _handle) -> CancelResponse:
        self.control.abort('cancelled by the client')
        return CancelResponse.ACCEPT

    def _switch(self, response: Trigger.Response, action: str, *args: str) -> Trigger.Response:
        with self._lock:
            running = self._busy
        if running:
            getattr(self.control, action)(*args)
        response.success, response.message = running, '' if running else 'no job is running'
        return response

    def _on_pause(self, _request, response: Trigger.Response) -> Trigger.Response:
        return self._switch(response, 'pause')

    def _on_resume(self, _request, response: Trigger.Response) -> Trigger.Response:
        return self._switch(response, 'resume')

    def _on_abort(self, _request, response: Trigger.Response) -> Trigger.Response:
        return self._switch(response, 'abort', 'aborted by the operator')

    # ---- the job -------------------------------------------------------------------------------

    async def _execute(self, handle) -> RunJob.Result:
        """Waits for the job's thread without blocking the executor."""
        from rclpy.task import Future

        done: Future = Future(executor=self.executor)
        worker = threading.Thread(target=self._work, args=(handle, done), name='job', daemon=True)
        worker.start()
        return await done

    def _work(self, handle, done) -> None:
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
        done.set_result(result)

    def _run(self, handle, result: RunJob.Result) -> None:
        goal = convert.goal_from_msg(handle.request, self.params.jobs_dir)
        self.cell.status(Status(state=State.VALIDATING, profile=goal.profile))
        try:
            checked = check(goal)
        except JobError as e:
            result.error_code, result.message = int(e.code), str(e)
            self.cell.status(Status(state=State.FAILED, error_code=int(e.code), message=str(e)))
            return
        folder = self._make_folder(goal, checked)
        runner = JobRunner(
            _WithFeedback(self.cell, handle), checked, folder, self.control, self._settings()
        )
        status = runner.run()
        result.error_code, result.message = status.error_code, status.message
        result.job_id, result.job_dir = folder.job_id, str(folder.path)
        result.layers, result.in_tolerance = status.layers, runner.in_tolerance
        result.rms = runner.final.rms if runner.final else math.nan
        result.max_error = runner.final.max if runner.final else math.nan

    def _make_folder(self, goal: JobGoal, checked: Checked) -> JobFolder:
        folder = JobFolder.create(goal.jobs_dir.resolve(), goal.title)
        if self.params.job_pointer:
            write_atomically(Path(self.params.job_pointer), str(folder.path))
        folder.write_yaml(
            'job.yaml',
            {
                'job_id': folder.job_id,
                'goal': {k: str(v) if isinstance(v, Path) else v for k, v in asdict(goal).items()},
                'material': asdict(checked.material),
                'parameters': asdict(self.params),
                **provenance(checked.part.sha256),
            },
        )
        return folder

    def _settings(self) -> Settings:
        p = self.params
        return Settings(
            work_offset=tuple(p.work_offset),
            plate_zero=tuple(p.plate_zero),
            margin=p.margin,
            resolution=p.resolution,
            follow_reach=p.follow_reach,
            cooling_timeout=p.cooling_timeout,
            share_in_tolerance=p.share_in_tolerance,
            lease_nodes=tuple(p.lease_nodes),
            limits=Limits(p.link_timeout, p.node_timeout, p.lease_retries),
        )


class _WithFeedback:
    """The cell, with every status also sent as feedback of the action."""

    def __init__(self, cell: RosCell, handle) -> None:
        self._cell, self._handle = cell, handle

    def __getattr__(self, name: str):
        return getattr(self._cell, name)

    def status(self, status: Status) -> None:
        self._cell.status(status)
        feedback = RunJob.Feedback()
        feedback.status = convert.status_to_msg(status, self._cell.node.get_clock().now().to_msg())
        self._handle.publish_feedback(feedback)


def main() -> None:
    os.environ.setdefault('OMP_NUM_THREADS', '1')
    run_main(JobSequencer)
