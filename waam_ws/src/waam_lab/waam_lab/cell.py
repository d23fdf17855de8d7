"""The cell as the job sees it (waam_job.model.cell.Cell), with everything behind it in this process.

Nothing waits: where a call would wait in the graph, simulated time passes. Requests and answers go through the same
messages as in the graph, so what is rounded there (maps are float32) is rounded here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from waam_adapt import answers
from waam_adapt import conversions as adapt_convert
from waam_adapt.laws.corrector import Corrector
from waam_adapt.thermal.compensator import Compensator
from waam_bridge import commands, program
from waam_bridge import conversions as bridge_convert
from waam_bridge.frames import ARC_ENABLED, ARC_ESTABLISHED, Telemetry
from waam_bridge.outbox import WARNING, Outbox
from waam_job import conversions as convert
from waam_job.model.cell import (
    Correction,
    CorrectionRequest,
    FeedRequest,
    Heat,
    LaidBeads,
    NextLayer,
    Scan,
    Sums,
)
from waam_job.model.cell import Machine as MachineView
from waam_job.model.geometry import aim_point
from waam_job.model.goal import Code, JobError
from waam_job.model.records import AnomalyRecord, LayerRecord, State, Status
from waam_job.model.telemetry import TelemetryStats
from waam_job.run.again import BURNS_A
from waam_msgs.msg import JobStatus, LayerReport
from waam_node.conversions import segment_from_msg, time_to_msg, to_msg
from waam_process.grid import GridError, GridSpec
from waam_process.operating import GANTRY
from waam_process.segment import Point, Segment
from waam_scan import conversions as scan_convert
from waam_sim.plant import Plant

from .contact import ContactTrace
from .job import Fault
from .machine import Machine
from .params import LabParams
from .process import LabControl, ProcessTrace
from .robot.robot_machine import RobotMachine
from .scanning import ScanError, Scanning
from .watch import LayerWatch

PACE = 15.0  # simulated seconds in a second that the job waits: about the rate of the graph


def _device(machine: str, params: LabParams, plant: Plant) -> Machine:
    if machine == GANTRY:
        return Machine(params.bridge, plant, params.job_sequencer.chuck_steps_per_turn)
    return RobotMachine(params.robot_bridge, plant)


class LabCell:
    """Implements waam_job.model.cell.Cell. `reports`, `anomalies`: what the job published; `spent`: s of simulated time
    that it was in a state."""

    def __init__(
        self,
        params: LabParams,
        plant: Plant,
        faults: tuple[Fault, ...] = (),
        watch: LayerWatch | None = None,
        machine: str = GANTRY,
    ) -> None:
        self.params, self._faults = params, list(faults)
        self.device = _device(machine, params, plant)
        self.scanning = Scanning(params.scan_fusion, self.device)
        self.thermal = Compensator(params.thermal_compensator)
        self.corrector = Corrector(params.correction_server)
        self.reports: list[LayerRecord] = []
        self.anomalies: list[AnomalyRecord] = []
        self.spent: dict[State, float] = {}
        self._burned: Point | None = None
        self._since: tuple[State, float] = (State.IDLE, 0.0)
        self._stats = TelemetryStats()
        self._view = MachineView()
        self._warnings: list[AnomalyRecord] = []
        self._parameters = params.by_node(machine)
        self._parameters.pop('job_sequencer')
        d = self.device
        d.on_frame, d.on_outbox = self._on_frame, self._on_outbox
        d.on_temperature, d.on_profiles = self._on_temperature, self.scanning.on_profiles
        self._watch = watch
        self.contact, self.process = ContactTrace(), ProcessTrace()
        self._control = LabControl(params.process_control, self.device)
        d.on_exchange = self._on_exchange
        d.connect()
        d.until(lambda: self.thermal.state(d.now).plausible, 5.0)

    def close(self) -> None:
        """Frees the controller."""
        self.device.close()

    def _on_exchange(self, samples: np.ndarray, plant: Plant) -> None:
        self.contact.on_exchange(samples, plant)
        self.process.on_exchange(samples, plant)

    # ---- what the cell tells -------------------------------------------------------------------

    def _on_frame(self, t: Telemetry) -> None:
        position = (t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6)
        self._stats.add(
            sequence=t.seq,
            controller_us=t.t_us,
            t=t.t_us * 1e-6,
            position=position,
            current=t.current_ma * 1e-3,
            voltage=t.voltage_mv * 1e-3,
            wire=t.wire_um_s * 1e-6,
            wire_commanded=t.wire_cmd_um_s * 1e-6,
            speed=t.v_um_s * 1e-6,
            arc=t.flags & ARC_ESTABLISHED != 0,
        )
        self._frame = t
        self._burned = position if t.current_ma > 1e3 * BURNS_A else self._burned
        self.scanning.on_frame(t)
        self._control.on_frame(t)

    def _on_outbox(self, box: Outbox) -> None:
        for mark in box.done:
            self._view = replace(self._view, executed=mark.index, executed_job=mark.job_id)
        if box.changed:
            msg = bridge_convert.machine_state(self.device.bridge, 'laboratory')
            self._view = replace(self._view, **convert.machine_fields(msg))
        for notice in box.notices:
            if notice.severity == WARNING:
                msg = bridge_convert.anomaly(self.device.bridge, notice)
                msg.header.stamp = time_to_msg(self.now())
                self._warnings.append(convert.anomaly_from_msg(msg))

    def _on_temperature(self, time_us: int, celsius: float) -> None:
        self.thermal.add(time_us * 1e-6, celsius)

    # ---- snapshots -----------------------------------------------------------------------------

    def now(self) -> float:
        """Simulated time, s: the controller's clock."""
        return self.device.now

    def wait(self, seconds: float) -> None:
        """PACE simulated seconds pass for each second that the job would wait."""
        self.device.advance(seconds * PACE)

    def machine(self) -> MachineView:
        """As of the last telemetry; `age` is 0, for nothing is ever late."""
        t = self._frame
        return replace(
            self._view,
            age=0.0,
            state=convert.STATES[t.state],
            position=(t.x_um * 1e-6, t.y_um * 1e-6, t.z_um * 1e-6),
            arc_on=t.flags & ARC_ENABLED != 0,
            burned=self._burned,
        )

    def heat(self) -> Heat:
        """From the compensator at this moment, through the message, so with its rounding."""
        t = self.thermal
        msg = adapt_convert.heat_to_msg(t.state(self.now()), t.limit, t.material)
        found = convert.heat_from_msg(msg)
        self._stats.temperature = found.temperature
        return found

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Those that this cell was made with."""
        return self._parameters

    def take_warnings(self) -> list[AnomalyRecord]:
        """Warnings of bridge and scanning since the last call."""
        taken, self._warnings = self._warnings, []
        for text in self.scanning.warnings:
            taken.append(AnomalyRecord(self.now(), 'WARNING', 'scan', text, 'none'))
        self.scanning.warnings.clear()
        return taken

    def take_sums(self) -> Sums:
        """Sums over the telemetry since the last call."""
        return self._stats.take_sums()

    def take_track(self) -> dict[str, np.ndarray]:
        """Telemetry since the last call: columns (n,) by name, SI."""
        return self._stats.take_track()

    # ---- what the job asks for -----------------------------------------------------------------

    def command(
        self,
        name: str,
        *,
        text: str = '',
        names: tuple[str, ...] = (),
        vector: Point = (0, 0, 0),
        value: float = 0.0,
    ) -> None:
        """JobError MACHINE_NOT_READY when the bridge or the controller refuses."""
        x, y, z = (float(v) for v in vector)
        command = commands.Command(
            getattr(commands, name), text, tuple(names), (x, y, z), float(value)
        )
        code, said = self.device.command(command)
        if code:
            raise JobError(Code.MACHINE_NOT_READY, f'bridge/command: {said} (error {code})')

    def enqueue(self, job_id: str, segments: list[Segment], last: bool) -> None:
        """JobError DEPOSITION_FAILED when the bridge refuses a segment; then none was taken."""
        bridge = self.device.bridge
        try:
            permit = bridge.permit(job_id, segments)
            bridge.commit(permit, program.prepare(permit, segments, last))
        except program.Refusal as e:
            text = f'bridge/enqueue: {e} (error {e.code})'
            raise JobError(Code.DEPOSITION_FAILED, text) from None

    def begin_scan(self, job_id: str, layer: int, spec: GridSpec, laid: LaidBeads) -> int:
        """JobError SCAN_FAILED when the grid is too large."""
        request = convert.begin_request(job_id, layer, spec, laid)
        try:
            return self.scanning.begin(job_id, layer, spec, scan_convert.laid_beads(request))
        except GridError as e:
            raise JobError(Code.SCAN_FAILED, f'scan_fusion/begin: {e}') from None

    def finish_scan(self, scan_id: int, until: float) -> Scan:
        """Time passes until telemetry has reached `until`. JobError SCAN_FAILED when there is no map."""
        try:
            scan = convert.scan_from_msg(self.scanning.finish(scan_id, until))
        except ScanError as e:
            raise JobError(Code.SCAN_FAILED, f'scan_fusion/finish: {e}') from None
        if self._watch is not None:
            self._watch.on_scan(scan.map.z)
        return scan

    def correct(self, job_id: str, request: CorrectionRequest) -> Correction:
        """JobError UNKNOWN when the request is refused."""
        message = convert.correction_request(job_id, request, time_to_msg(self.now()))
        try:
            answer, _, learned = answers.correct(self.corrector, message, self.now())
        except ValueError as e:
            raise JobError(Code.UNKNOWN, f'correction_server/compute: {e}') from None
        if self._watch is not None:
            self._watch.on_correction(message, answer, self.corrector)
        return convert.correction_from_msg(answer, learned)

    def setpoints(self, job_id: str, request: FeedRequest) -> list[Segment]:
        """JobError PLAN_FAILED when the request is refused."""
        message = convert.feed_request(job_id, request)
        try:
            answers.set_feed(self.params.feed_forward, message)
        except ValueError as e:
            raise JobError(Code.PLAN_FAILED, f'feed_forward/compute: {e}') from None
        return [segment_from_msg(s) for s in message.segments]

    # ---- what the job tells --------------------------------------------------------------------

    def record(self, start: bool, directory: str, custom: tuple[str, ...] = ()) -> str:
        """There is no recorder: a job of the laboratory can be run again."""
        return 'not recorded'

    def plan(self, job_id: str, layer: int, segments: list[Segment]) -> None:
        """The pyrometer follows the metal, as by the topic pyrometer_aim."""
        point = aim_point(segments)
        if point is not None:
            offset, zero = self.machine().work_offset, self.device.plant.params.work_zero
            x, y = (p + o - z for p, o, z in zip(point[:2], offset, zero, strict=False))
            self.device.plant.aim(x, y)

    def next_layer(self, job_id: str, coming: NextLayer) -> None:
        """Nobody waits for an answer here: nothing is prepared."""

    def status(self, status: Status) -> None:
        """Tells the compensator; injects the faults of a layer when its deposition begins."""
        self._account(status.state)
        answers.follow_job(self.thermal, to_msg(JobStatus, status, stamp=time_to_msg(self.now())))
        deposits = status.state == State.DEPOSITING
        self._stats.layer = self.process.layer = status.layer if deposits else 0
        for fault in [f for f in self._faults if deposits and f.layer == status.layer]:
            self._faults.remove(fault)
            self.device.plant.faults.inject(fault.name, fault.value, self.device.plant.now)

    def _account(self, state: State) -> None:
        before, since = self._since
        self._since = state, self.now()
        self.spent[before] = self.spent.get(before, 0.0) + self.now() - since

    def layer_report(self, report: LayerRecord) -> None:
        """Tells the compensator; kept in `reports`."""
        answers.follow_layer(
            self.thermal, to_msg(LayerReport, report, stamp=time_to_msg(self.now()))
        )
        self.reports.append(report)

    def anomaly(self, anomaly: AnomalyRecord) -> None:
        """Kept in `anomalies`."""
        self.anomalies.append(anomaly)
