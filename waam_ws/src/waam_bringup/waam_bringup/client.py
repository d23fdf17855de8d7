"""The command line's end of the graph: one short-lived ROS node that waits for readiness, loads parts and runs jobs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any
from uuid import uuid4

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from std_srvs.srv import Trigger
from unique_identifier_msgs.msg import UUID

from waam_msgs.action import RunJob
from waam_msgs.msg import (
    Heartbeat,
    JobStatus,
    MachineState,
    Override,
    ProcessControl,
    Telemetry,
)
from waam_msgs.srv import LoadPart
from waam_node.override import in_force
from waam_node.qos import BEAT, LATCHED, NEWEST, TELEMETRY

MATCHING_S = 0.8  # a server that has not yet found a new client's reader loses the answer
MATCHED_S = 8.0  # at most, for the readers of an override; then it goes to those that are there
REPEAT_S = 4.0
SERVER_S = 15.0  # at most, for a server to be found: on a busy machine discovery takes seconds
ANSWER_S = 10.0
SENDINGS = 3  # of a goal that did not reach its server
ASKINGS = 6  # for the result of a goal that was not answered
ALIVE_S = 0.5  # between two looks whether the graph is still there
NO_CONTROLLER_S = 6.0  # the virtual controller may come up after the bridge


class ClientError(RuntimeError):
    """The graph does not answer, or it refused; the text says what and what to do."""


class GraphClient:
    """Use as a context manager. All waiting is bounded and lets the executor run."""

    def __init__(self, domain: int, namespace: str = '') -> None:
        self.context = rclpy.context.Context()
        rclpy.init(context=self.context, domain_id=domain)
        name = f'waam_cli_{os.getpid()}'
        self.node = rclpy.create_node(name, context=self.context, namespace=namespace)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.machine: MachineState | None = None
        self.job: JobStatus | None = None
        self._action: ActionClient | None = None
        self.node.create_subscription(MachineState, 'machine_state', self._on_machine, LATCHED)
        self.node.create_subscription(JobStatus, 'job_status', self._on_job, LATCHED)

    def __enter__(self) -> GraphClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.executor.shutdown()
        if self._action:  # it must be destroyed here: the rest of it would keep the participant,
            self._action.destroy()  # which ends in a segmentation fault while the executor still runs
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _on_machine(self, message: MachineState) -> None:
        self.machine = message

    def _on_job(self, message: JobStatus) -> None:
        self.job = message

    def until(self, condition: Callable[[], Any], timeout: float) -> bool:
        """Spins until the condition holds; False after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def wait_ready(
        self,
        nodes: set[str],
        timeout: float,
        dead: Callable[[], dict[str, str]],
        patience: float = NO_CONTROLLER_S,
    ) -> None:
        """Until the controller answers and every node has repeated a tick. `dead` names processes that ended.

        Heartbeats are heard only here: hundreds a second would cost a command that follows a job a tenth of a core.
        """
        beating: set[str] = set()

        def beat(message: Heartbeat) -> None:
            beating.add(message.node)

        beats = self.node.create_subscription(Heartbeat, 'heartbeat', beat, BEAT)
        try:
            self._until_ready(nodes, beating, timeout, dead, patience)
        finally:
            self.node.destroy_subscription(beats)

    def _until_ready(
        self,
        nodes: set[str],
        beating: set[str],
        timeout: float,
        dead: Callable[[], dict[str, str]],
        patience: float,
    ) -> None:
        end = time.monotonic() + timeout
        refused_since: float | None = None
        while True:
            refused_since = self._refused(refused_since, patience)
            if gone := dead():
                raise ClientError('; '.join(f'{n} {how}' for n, how in gone.items()))
            missing = nodes - beating
            if not missing and self.machine and self.machine.connected:
                return
            if time.monotonic() > end:
                text = self.machine.message if self.machine and not self.machine.connected else ''
                who = ', '.join(sorted(missing)) or 'the controller'
                why = text or f'{who} does not answer'  # ticks come from the controller
                raise ClientError(f'not ready after {timeout:.0f} s: {why}')
            self.executor.spin_once(timeout_sec=0.1)

    def _refused(self, since: float | None, patience: float) -> float | None:
        """ClientError once the bridge has said for `patience` s that there is no controller at its port."""
        if self.machine is None or self.machine.connected or not self.machine.message:
            return None
        since = since or time.monotonic()
        if time.monotonic() - since > patience:
            raise ClientError(f'no controller: {self.machine.message}')
        return since

    def call(
        self, kind: Any, name: str, request: Any, timeout: float = 20.0, repeat: bool = True
    ) -> Any:
        """A service call, or ClientError.

        repeat: ask again every REPEAT_S, for the answer to a new client may be lost; only for requests that do no harm
        twice.
        """
        client = self.node.create_client(kind, name)
        if not self.until(client.service_is_ready, SERVER_S):
            raise ClientError(f'service {name} is not there; is the graph up? (waam up)')
        self.until(lambda: False, MATCHING_S)
        asked, end = [], time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            asked.append(client.call_async(request))
            if self.until(lambda: any(f.done() for f in asked), REPEAT_S if repeat else left):
                return next(f.result() for f in asked if f.done())
        raise ClientError(f'service {name} did not answer within {timeout:.0f} s')

    def trigger(self, name: str) -> None:
        """Calls a service without arguments. ClientError with its message when it refuses."""
        response = self.call(Trigger, name, Trigger.Request())
        if not response.success:
            raise ClientError(response.message)

    def resume(self) -> bool:
        """Resumes the running or paused job; False when there is none. Asks the sequencer itself: a status that has not
        arrived yet would look like no job."""
        return self.call(Trigger, 'job_sequencer/resume', Trigger.Request()).success

    def running_job(self) -> JobStatus | None:
        """None when no job runs. ClientError without a status: job_sequencer latches one."""
        self.until(lambda: self.job is not None, SERVER_S)
        if self.job is None:
            raise ClientError('job_sequencer is not there; is the graph up? (waam up)')
        return self.job if JobStatus.IDLE < self.job.state < JobStatus.DONE else None

    def override(self, speed: float, wire: float, source: str) -> tuple[float, float]:
        """Factors (NaN = as it is), asked for until telemetry shows them; ClientError when it never does. A process
        control multiplies them by its own, and must have heard them, or it would take them back."""
        seen: list[Telemetry] = []
        control: list[ProcessControl] = []
        listening = self.node.create_subscription(Telemetry, 'telemetry', seen.append, TELEMETRY)
        controls = self.node.create_subscription(
            ProcessControl, 'process_control', control.append, TELEMETRY
        )
        publisher = self.node.create_publisher(Override, 'override', NEWEST)

        def taken() -> bool:
            del seen[:-1], control[:-1]
            last = control[-1] if control else None
            return bool(seen) and in_force(seen[-1], last, speed, wire)

        def matched() -> bool:
            readers = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
            here = any(r.node_name == 'job_sequencer' for r in readers)
            return here and publisher.get_subscription_count() >= len(readers)

        try:
            self.until(matched, MATCHED_S)  # the job must receive it as well, not only the bridge
            for _ in range(5):
                publisher.publish(Override(speed_factor=speed, wire_factor=wire, source=source))
                if self.until(taken, 2.0):
                    return seen[-1].speed_override, seen[-1].wire_override
        finally:
            self.node.destroy_subscription(listening)
            self.node.destroy_subscription(controls)
        raise ClientError('the controller did not take the override over (waam status)')

    def load_part(self, mesh: str, plate: tuple[float, float, float], seed: int) -> None:
        """Simulated cell: what lies on the table. plate in m, used when mesh is '', or (diameter, height of its nominal
        surface on its map, 0) of a shaft in the chuck (LoadPart.srv)."""
        request = LoadPart.Request(mesh_path=mesh, seed=seed)
        request.plate.x, request.plate.y, request.plate.z = plate
        response = self.call(LoadPart, 'cell/load_part', request)
        if not response.success:
            raise ClientError(f'the cell refused the part: {response.message}')

    def run_job(
        self,
        goal: RunJob.Goal,
        on_status: Callable[[JobStatus], None],
        alive: Callable[[], str] = lambda: '',
    ) -> RunJob.Result:
        """Sends the goal and waits for its result; Ctrl-C cancels the job.

        `alive` returns a reason when the graph is gone.
        """
        self._action = self._action or ActionClient(self.node, RunJob, 'job_sequencer/run_job')
        action = self._action
        if not self.until(action.server_is_ready, SERVER_S):
            raise ClientError('job_sequencer is not there; is the graph up? (waam up)')
        self.until(lambda: False, MATCHING_S)
        for _ in range(SENDINGS):
            handle, answered = self._send_goal(action, goal, lambda f: on_status(f.feedback.status))
            result = self._result(handle, answered, alive)
            if result.status != GoalStatus.STATUS_UNKNOWN:
                return result.result
            if answered:
                break
        raise ClientError('job_sequencer did not answer the goal')

    def _result(self, handle: ClientGoalHandle, answered: bool, alive: Callable[[], str]) -> Any:
        """The answer of the server: status and result. Ctrl-C cancels the job."""
        asked = [handle.get_result_async()]
        try:
            self._await_result(handle, asked, answered, alive)
        except KeyboardInterrupt:
            handle.cancel_goal_async()
            if not self.until(lambda: _done(asked), 30.0):
                raise ClientError('cancelled, but the job did not end within 30 s') from None
        return _done(asked)[0].result()

    def _send_goal(
        self, action: ActionClient, goal: RunJob.Goal, feedback: Callable[[Any], None]
    ) -> tuple[ClientGoalHandle, bool]:
        """The goal, and whether its server has answered. ClientError when the goal is refused.

        The answer to a new client may be lost while the job runs already: its result is then requested by the goal's
        id. A server that does not know the id never got the goal, as happens just after a restart; it is sent again.
        """
        name = UUID(uuid=list(uuid4().bytes))
        sent = action.send_goal_async(goal, feedback_callback=feedback, goal_uuid=name)
        try:
            answered = self.until(sent.done, ANSWER_S)
        except KeyboardInterrupt:  # it may be accepted yet: then it is cancelled
            sent.add_done_callback(_cancel)
            self.until(sent.done, ANSWER_S)
            raise
        if not answered:
            assumed = RunJob.Impl.SendGoalService.Response(accepted=True)
            return ClientGoalHandle(action, name, assumed), False
        handle = sent.result()
        if not handle.accepted:
            raise ClientError(
                'a job is running already; the goal was refused (waam status, waam job abort)'
            )
        return handle, True

    def _await_result(
        self,
        handle: ClientGoalHandle,
        asked: list[Future],
        answered: bool,
        alive: Callable[[], str],
    ) -> None:
        """Until one of the requests `asked` is answered. A goal that was not answered may have gone to a server that
        has just died, and so may the first requests for its result: they are repeated.

        `alive` reads files: it is called twice a second, not at every message.
        """
        again = time.monotonic() + ANSWER_S
        while not self.until(lambda: _done(asked), ALIVE_S):
            if reason := alive():
                if self.until(lambda: _done(asked), 1.0):
                    return
                raise ClientError(reason)
            if not answered and len(asked) < ASKINGS and time.monotonic() > again:
                asked.append(handle.get_result_async())
                again += ANSWER_S


def _cancel(sent: Future) -> None:
    if sent.result().accepted:
        sent.result().cancel_goal_async()


def _done(asked: list[Future]) -> list[Future]:
    """Those that have a result."""
    return [f for f in asked if f.done()]
