"""The command line's end of the graph: one short-lived ROS node that waits for readiness, loads parts and runs jobs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.experimental import EventsExecutor
from std_srvs.srv import Trigger

from waam_msgs.action import RunJob
from waam_msgs.msg import Heartbeat, JobStatus, MachineState
from waam_msgs.srv import LoadPart
from waam_node.qos import BEAT, LATCHED

MATCHING_S = 0.2  # a server that has not yet found a new client's reader loses the answer
NO_CONTROLLER_S = 6.0  # the virtual controller may come up after the bridge


class ClientError(RuntimeError):
    """The graph does not answer, or it refused; the text says what and what to do."""


class GraphClient:
    """Use as a context manager. All waiting is bounded and lets the executor run."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.context.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node(f'waam_cli_{os.getpid()}', context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.machine: MachineState | None = None
        self.job: JobStatus | None = None
        self.beating: set[str] = set()
        self.node.create_subscription(MachineState, 'machine_state', self._on_machine, LATCHED)
        self.node.create_subscription(JobStatus, 'job_status', self._on_job, LATCHED)
        self.node.create_subscription(Heartbeat, 'heartbeat', self._on_beat, BEAT)

    def __enter__(self) -> GraphClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _on_machine(self, message: MachineState) -> None:
        self.machine = message

    def _on_job(self, message: JobStatus) -> None:
        self.job = message

    def _on_beat(self, message: Heartbeat) -> None:
        self.beating.add(message.node)

    def until(self, condition: Callable[[], Any], timeout: float) -> bool:
        """Spins until the condition holds; False after `timeout` seconds."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def wait_ready(
        self, nodes: set[str], timeout: float, dead: Callable[[], dict[str, str]]
    ) -> None:
        """Until the controller answers and every node has repeated a tick. `dead` names processes that ended."""
        end = time.monotonic() + timeout
        refused_since: float | None = None
        while True:
            refused_since = self._refused(refused_since)
            if gone := dead():
                raise ClientError('; '.join(f'{n} {how}' for n, how in gone.items()))
            missing = nodes - self.beating
            if not missing and self.machine and self.machine.connected:
                return
            if time.monotonic() > end:
                text = self.machine.message if self.machine and not self.machine.connected else ''
                who = ', '.join(sorted(missing)) or 'the controller'
                raise ClientError(f'not ready after {timeout:.0f} s: {who} does not answer. {text}')
            self.executor.spin_once(timeout_sec=0.1)

    def _refused(self, since: float | None) -> float | None:
        """ClientError once the bridge has said for some seconds that there is no controller at its port."""
        if self.machine is None or self.machine.connected or not self.machine.message:
            return None
        since = since or time.monotonic()
        if time.monotonic() - since > NO_CONTROLLER_S:
            raise ClientError(f'no controller: {self.machine.message}')
        return since

    def call(self, kind: Any, name: str, request: Any, timeout: float = 20.0) -> Any:
        """A service call, or ClientError."""
        client = self.node.create_client(kind, name)
        if not self.until(client.service_is_ready, 5.0):
            raise ClientError(f'service {name} is not there; is the graph up? (waam up)')
        self.until(lambda: False, MATCHING_S)
        future = client.call_async(request)
        if not self.until(future.done, timeout):
            raise ClientError(f'service {name} did not answer within {timeout:.0f} s')
        return future.result()

    def trigger(self, name: str) -> None:
        response = self.call(Trigger, name, Trigger.Request())
        if not response.success:
            raise ClientError(response.message)

    def load_part(self, mesh: str, plate: tuple[float, float, float], seed: int) -> None:
        """Simulated cell: what lies on the table. plate in m, used when mesh is ''."""
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
        action = ActionClient(self.node, RunJob, 'job_sequencer/run_job')
        if not self.until(action.server_is_ready, 5.0):
            raise ClientError('job_sequencer is not there; is the graph up? (waam up)')
        sent = action.send_goal_async(
            goal, feedback_callback=lambda f: on_status(f.feedback.status)
        )
        if not self.until(sent.done, 10.0):
            raise ClientError('job_sequencer did not answer the goal within 10 s')
        handle = sent.result()
        if not handle.accepted:
            raise ClientError(
                'a job is running already; the goal was refused (waam status, waam job abort)'
            )
        result = handle.get_result_async()
        try:
            self._await_result(result, alive)
        except KeyboardInterrupt:
            handle.cancel_goal_async()
            if not self.until(result.done, 30.0):
                raise ClientError('cancelled, but the job did not end within 30 s') from None
        return result.result().result

    def _await_result(self, result: Any, alive: Callable[[], str]) -> None:
        while not result.done():
            if reason := alive():
                if self.until(result.done, 1.0):
                    return
                raise ClientError(reason)
            self.executor.spin_once(timeout_sec=0.1)
