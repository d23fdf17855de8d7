"""The operations of the page as services, actions and topics of the graph. Each blocks its worker thread only."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Vector3
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from waam_calibrate.results import told_by
from waam_msgs.action import RunJob
from waam_msgs.srv import AdjustJob, Command, LoadPart
from waam_node import restart
from waam_node.node import CallError, WaamNode, call
from waam_process.operating import BUILD_PLATE

from . import conversions as cv
from .node_override import OverrideOrder
from .node_standoff import BridgeStandoff
from .operations import Refused, StandoffSettings
from .programs import ProgramChoice
from .setup_form import JobSetup

PATIENCE_S = 5.0
STOP_PATIENCE_S = 3.0
START_PATIENCE_S = 10.0
LOAD_PATIENCE_S = 60.0


class RosOperations:
    """See `operations.Operations`."""

    def __init__(self, node: WaamNode, run: Path | None = None) -> None:
        self._node, self._run = node, run
        client = node.create_client
        self._command = client(Command, 'bridge/command')
        self._switches = {
            n: client(Trigger, f'job_sequencer/{n}') for n in ('pause', 'resume', 'abort')
        }
        self._adjust = client(AdjustJob, 'job_sequencer/adjust')
        self._load = client(LoadPart, 'cell/load_part')
        self._job = ActionClient(node, RunJob, 'job_sequencer/run_job')
        self.order = OverrideOrder(node)
        self._standoff = BridgeStandoff(node)
        self._pair = ThreadPoolExecutor(8, 'pair')

    @property
    def simulated(self) -> bool:
        """Only the simulated cell offers the service cell/load_part."""
        return self._load.service_is_ready()

    @property
    def adjustable(self) -> bool:
        """Whether job_sequencer/adjust is there."""
        return self._adjust.service_is_ready()

    # ---- stop, pause, resume

    def stop(self) -> str:
        """Ends the job and stops the machine, on separate threads: one that hangs does not hold up the other."""
        return self._both(
            lambda: self._send('STOP', patience=STOP_PATIENCE_S),
            lambda: self._switch('abort', STOP_PATIENCE_S),
            'stopped',
        )

    def pause(self, job_running: bool) -> str:
        """The machine holds at once (real-time byte); the job is paused as well, so that it waits."""
        if not job_running:
            return self._send('HOLD')
        return self._both(lambda: self._send('HOLD'), lambda: self._switch('pause'), 'paused')

    def resume(self, job_running: bool) -> str:
        """The job goes on; without one RESUME goes to the machine."""
        return self._switch('resume') if job_running else self._send('RESUME')

    def _both(self, machine: Any, job: Any, done: str) -> str:
        """Runs both at the same time. One success is enough; the message of the other is added."""
        failed = []
        running = {'machine': self._pair.submit(machine), 'job': self._pair.submit(job)}
        for name, future in running.items():
            try:
                future.result(PATIENCE_S + 1.0)
            except (Refused, TimeoutError) as e:
                failed.append(f'{name}: {e}')
        if len(failed) == 2:
            raise Refused('; '.join(failed))
        return f'{done} ({failed[0]})' if failed else done

    def _switch(self, name: str, patience: float = PATIENCE_S) -> str:
        response = self._call(self._switches[name], Trigger.Request(), patience)
        if not response.success:
            raise Refused(response.message)
        return {'pause': 'paused', 'resume': 'goes on', 'abort': 'aborted'}[name]

    # ---- machine

    def command(self, name: str) -> str:
        """A command without arguments, by the name of its constant in Command.srv."""
        return self._send(name)

    def arm(self, job: str) -> str:
        """The bridge shows the first 100 characters of `job`."""
        return self._send('ARM', text=job[:100])

    def jog(self, move: tuple[float, float, float], speed: float) -> str:
        """move: m along x, y, z; speed: m/s."""
        x, y, z = move
        return self._send('JOG', vector=Vector3(x=x, y=y, z=z), value=speed)

    def jog_wire(self, length: float) -> str:
        """m, negative = back."""
        return self._send('JOG_WIRE', value=length)

    def set_zero(self) -> str:
        """The present position becomes the work zero."""
        return self._send('SET_ZERO', value=1.0)

    def override(self, speed: float, wire: float) -> str:
        """What is in force then. Refused when the telemetry does not show it in time."""
        return self.order.send(speed, wire)

    def settings(self) -> dict[str, float]:
        """See `waam_calibrate.results.told_by`. Refused while segments wait, or by a machine that has none."""
        return told_by(self._send('SETTINGS'))

    def standoff(self) -> StandoffSettings:
        """Parameters of the bridge."""
        return self._standoff.read()

    def set_standoff(self, wanted: StandoffSettings) -> str:
        """Refused while a job is armed or the machine runs."""
        return self._standoff.write(wanted)

    def _send(self, name: str, patience: float = PATIENCE_S, **fields: Any) -> str:
        request = Command.Request(code=getattr(Command.Request, name), **fields)
        response = self._call(self._command, request, patience)
        if response.error_code:
            raise Refused(response.message or f'{name}: error {response.error_code}')
        return response.message or f'{name.lower().replace("_", " ")}: done'

    def _call(self, client: Any, request: Any, patience: float) -> Any:
        try:
            return call(client, request, patience)
        except CallError as e:
            raise Refused(str(e)) from None

    # ---- jobs

    def adjust(self, what: str, value: float) -> str:
        """what: name of the constant in AdjustJob.srv. Refused when the job does not take it."""
        if not self.adjustable:
            raise Refused('the job of this cell does not take this while it runs')
        request = AdjustJob.Request(code=getattr(AdjustJob.Request, what), value=value)
        response = self._call(self._adjust, request, PATIENCE_S)
        if not response.success:
            raise Refused(response.message)
        return response.message or 'taken'

    def load(self, setup: JobSetup, as_found: Path | None) -> str:
        """Simulated cell: the worn part (the part itself when none is said), or a plate for a build."""
        if not self.simulated:
            return 'loaded; the part on the table is scanned when the job starts'
        if setup.mode == 'restore' and as_found is None:
            raise Refused('simulated cell: choose what lies on the table (as found)')
        request = LoadPart.Request(mesh_path=str(as_found) if as_found else '', seed=-1)
        if setup.mode == 'build':
            request.mesh_path = ''
            request.plate.x, request.plate.y, request.plate.z = BUILD_PLATE
        response = self._call(self._load, request, LOAD_PATIENCE_S)
        if not response.success:
            raise Refused(response.message)
        return 'loaded and put on the simulated table'

    def start(self, setup: JobSetup, part: Path, jobs_dir: Path) -> str:
        """Returns when the job is accepted; everything after that is in job_status."""
        return self._run_job(cv.goal(setup, part, jobs_dir))

    def start_program(
        self, choice: ProgramChoice, program: Path, nominal: Path | None, jobs_dir: Path
    ) -> str:
        """Returns when the job is accepted; everything after that is in job_status."""
        return self._run_job(cv.program_goal(choice, program, nominal, jobs_dir))

    def resume_job(self, folder: Path) -> str:
        """Returns when the job is accepted; everything after that is in job_status."""
        return self._run_job(cv.resumed(folder))

    def _run_job(self, goal: RunJob.Goal) -> str:
        """Returns when the job is accepted; everything after that is in job_status."""
        end = time.monotonic() + START_PATIENCE_S
        while not self._job.server_is_ready():
            if time.monotonic() > end:
                raise Refused('job_sequencer is not there')
            time.sleep(0.05)
        answered = threading.Event()
        sent = self._job.send_goal_async(goal)
        sent.add_done_callback(lambda _: answered.set())
        if not answered.wait(max(0.1, end - time.monotonic())):
            sent.add_done_callback(_withdraw)
            raise Refused(f'job_sequencer did not answer within {START_PATIENCE_S:.0f} s')
        if not sent.result().accepted:
            raise Refused('a job is running already')
        return 'started'

    # ---- programs

    def restart_programs(self) -> str:
        """Disarms first: a program that wakes up once more before it is ended must not strike an arc."""
        if self._run is None:
            raise Refused(
                'this cell was not started by waam up: start its programs where they were started'
            )
        with suppress(Refused):  # a bridge that is dead itself
            self._send('DISARM', patience=STOP_PATIENCE_S)
        try:
            started = restart.ask(self._run)
        except restart.NoSupervisor as e:
            raise Refused(str(e)) from None
        return f'started again: {", ".join(started)}' if started else 'no program is dead or hangs'

    def close(self) -> None:
        """Ends the threads without waiting for what they do."""
        self._pair.shutdown(wait=False, cancel_futures=True)


def _withdraw(sent: Any) -> None:
    """A goal that is accepted after the operator was told that it was not: the job must not run."""
    if sent.result().accepted:
        sent.result().cancel_goal_async()
