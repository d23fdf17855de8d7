"""The graph behind the `Cell` interface: topics into snapshots, services with timeouts."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from rclpy.client import Client

from waam_msgs.msg import (
    Anomaly,
    HeatFactor,
    JobStatus,
    LayerPlan,
    LayerReport,
    MachineState,
    NextLayer,
    SegmentDone,
    Telemetry,
)
from waam_msgs.srv import (
    BeginScan,
    Command,
    ComputeCorrection,
    ComputeFeed,
    Enqueue,
    FinishScan,
    Record,
)
from waam_node.conversions import (
    seconds,
    segment_from_msg,
    segment_to_msg,
    time_to_msg,
    to_msg,
)
from waam_node.node import CallError, WaamNode, call
from waam_node.qos import EVENTS, LATCHED, TELEMETRY
from waam_process.grid import GridSpec
from waam_process.segment import Point, Segment

from .. import conversions as convert
from ..model import cell as model
from ..model.cell import Correction, CorrectionRequest, FeedRequest, Heat, Machine, Scan, Sums
from ..model.geometry import aim_point
from ..model.goal import Code, JobError
from ..model.records import AnomalyRecord, LayerRecord, State, Status
from ..model.telemetry import TelemetryStats
from ..run.again import BURNS_A
from .ros_parameters import ParameterReader

ENQUEUE_CHUNK = 400
SILENT = 5.0  # s of silence of a node after which a call to it is given up


class RosCell:
    """Subscriptions keep the newest snapshots; services are called from the job's thread, never from a callback."""

    def __init__(self, node: WaamNode, service_timeout: float) -> None:
        self.node, self.timeout = node, service_timeout
        self.job_id = ''
        self._machine, self._heat = Machine(), Heat()
        self._heat_heard = 0.0  # s, steady clock
        self._seen, self._pos_at = 0.0, 0.0
        self._burned: Point | None = None
        self._stats, self._lock = TelemetryStats(), threading.Lock()
        node.create_subscription(Telemetry, 'telemetry', self._on_telemetry, TELEMETRY)
        node.create_subscription(MachineState, 'machine_state', self._on_machine, LATCHED)
        node.create_subscription(SegmentDone, 'segment_done', self._on_done, EVENTS)
        self._own: deque[str] = deque(maxlen=64)  # texts that this node has published
        self._warnings: list[AnomalyRecord] = []
        node.create_subscription(Anomaly, 'anomaly', self._on_anomaly, EVENTS)
        node.create_subscription(HeatFactor, 'heat_factor', self._on_heat, LATCHED)
        self._status = node.create_publisher(JobStatus, 'job_status', LATCHED)
        self._report = node.create_publisher(LayerReport, 'layer_report', EVENTS)
        self._anomaly = node.create_publisher(Anomaly, 'anomaly', EVENTS)
        self._plan = node.create_publisher(LayerPlan, 'layer_plan', LATCHED)
        self._next = node.create_publisher(NextLayer, 'next_layer', LATCHED)
        self._aim = node.create_publisher(PointStamped, 'pyrometer_aim', LATCHED)
        client = node.create_client
        self._command = client(Command, 'bridge/command')
        self._enqueue = client(Enqueue, 'bridge/enqueue')
        self._begin = client(BeginScan, 'scan_fusion/begin')
        self._finish = client(FinishScan, 'scan_fusion/finish')
        self._correct = client(ComputeCorrection, 'correction_server/compute')
        self._feed = client(ComputeFeed, 'feed_forward/compute')
        self._record = client(Record, 'recorder/control')
        self._reader = ParameterReader(node)
        self._parameters: dict[str, dict[str, Any]] = {}

    # ---- topics (executor thread) --------------------------------------------------------------

    def _on_telemetry(self, m: Telemetry) -> None:
        p = m.position
        with self._lock:
            self._seen = time.monotonic()
            self._state, self._pos, self._arc = m.state, (p.x, p.y, p.z), m.arc_enabled
            self._pos_at = seconds(m.header.stamp)
            if m.arc_current > BURNS_A:
                self._burned = self._pos
            self._stats.add(
                sequence=m.sequence,
                controller_us=m.controller_us,
                t=seconds(m.header.stamp),
                position=self._pos,
                current=m.arc_current,
                voltage=m.arc_voltage,
                wire=m.wire_feed_speed,
                wire_commanded=m.wire_feed_commanded,
                speed=m.travel_speed,
                arc=m.arc_established,
            )

    def _on_machine(self, m: MachineState) -> None:
        with self._lock:
            self._machine = replace(self._machine, **convert.machine_fields(m))

    def _on_done(self, m: SegmentDone) -> None:
        with self._lock:
            self._machine = replace(self._machine, executed=m.index, executed_job=m.job_id)

    def _on_anomaly(self, m: Anomaly) -> None:
        if m.severity == Anomaly.WARNING and m.text not in self._own:
            with self._lock:
                self._warnings.append(convert.anomaly_from_msg(m))

    def _on_heat(self, m: HeatFactor) -> None:
        with self._lock:
            self._heat, self._heat_heard = convert.heat_from_msg(m), time.monotonic()
            self._stats.temperature = m.temperature

    # ---- snapshots (job thread) ----------------------------------------------------------------

    def now(self) -> float:
        """ROS time, s: simulated time when the graph runs on it."""
        return self.node.now_s()

    def wait(self, seconds: float) -> None:
        """Sleeps in the job's thread; seconds of wall time."""
        time.sleep(seconds)

    def machine(self) -> Machine:
        """`age` is the wall time since the last telemetry, s; before the first frame the defaults of Machine."""
        with self._lock:
            if not self._seen:
                return self._machine
            return replace(
                self._machine,
                age=time.monotonic() - self._seen,
                state=convert.STATES[self._state],
                position=self._pos,
                position_at=self._pos_at,
                arc_on=self._arc,
                burned=self._burned,
            )

    def heat(self) -> Heat:
        """The newest heat_factor; not `known` before the first one, not plausible when it is old."""
        with self._lock:
            return self._heat.heard(time.monotonic() - self._heat_heard)

    def read_parameters(self) -> None:
        """Asks the other nodes; takes some seconds when one of them is gone."""
        self._parameters = self._reader.read()

    def parameters(self) -> dict[str, dict[str, Any]]:
        """As of the last `read_parameters`."""
        return self._parameters

    def take_warnings(self) -> list[AnomalyRecord]:
        """Warnings of other nodes; those that this node has published itself are left out."""
        with self._lock:
            taken, self._warnings = self._warnings, []
            return taken

    def take_sums(self) -> Sums:
        """Sums over the telemetry since the last call."""
        with self._lock:
            return self._stats.take_sums()

    def take_track(self) -> dict[str, np.ndarray]:
        """Telemetry since the last call: columns (n,) by name, SI."""
        with self._lock:
            return self._stats.take_track()

    # ---- services ------------------------------------------------------------------------------

    def _call(self, client: Client, request: Any, code: Code, timeout: float = 0.0) -> Any:
        """The response, or JobError: NODE_LOST when nobody answers, `code` when the answer is an error."""
        try:
            response = call(client, request, timeout or self.timeout, self._silence_of(client))
        except CallError as e:
            raise JobError(Code.NODE_LOST, str(e)) from None
        if response.error_code:
            raise JobError(
                code, f'{client.srv_name}: {response.message} (error {response.error_code})'
            )
        return response

    def _silence_of(self, client: Client) -> Callable[[], str | None]:
        """For a call that waits: the reason to give up when the node that should answer has fallen silent, else ''."""
        name = client.srv_name.strip('/').split('/')[0]
        answered = time.monotonic()

        def reason() -> str | None:
            nonlocal answered
            machine = self.machine()
            silent = name in machine.silent_nodes
            if name == 'bridge':
                silent = self._seen > 0 and machine.age > SILENT
            elif not silent:
                answered = time.monotonic()
            else:  # a busy node comes back
                silent = time.monotonic() - answered > SILENT
            return f'{name} is silent' if silent else None

        return reason

    def command(
        self,
        name: str,
        *,
        text: str = '',
        names: tuple[str, ...] = (),
        vector: Point = (0, 0, 0),
        value: float = 0.0,
    ) -> None:
        """JobError MACHINE_NOT_READY when the bridge refuses, NODE_LOST when it does not answer."""
        code = getattr(Command.Request, name)
        request = to_msg(
            Command.Request, code=code, text=text, names=names, vector=vector, value=value
        )
        self._call(self._command, request, Code.MACHINE_NOT_READY)

    def enqueue(self, job_id: str, segments: list[Segment], last: bool) -> None:
        """In chunks of ENQUEUE_CHUNK. JobError DEPOSITION_FAILED when one is refused, NODE_LOST without an answer."""
        for i in range(0, len(segments), ENQUEUE_CHUNK):
            chunk = segments[i : i + ENQUEUE_CHUNK]
            request = Enqueue.Request(job_id=job_id, segments=[segment_to_msg(s) for s in chunk])
            request.last = last and i + ENQUEUE_CHUNK >= len(segments)
            self._call(self._enqueue, request, Code.DEPOSITION_FAILED)

    def begin_scan(self, job_id: str, layer: int, spec: GridSpec, laid: model.LaidBeads) -> int:
        """JobError SCAN_FAILED when the grid or the scanner is refused, NODE_LOST without an answer."""
        request = convert.begin_request(job_id, layer, spec, laid)
        return self._call(self._begin, request, Code.SCAN_FAILED).scan_id

    def finish_scan(self, scan_id: int, until: float) -> Scan:
        """Waits up to 10 s longer than for other answers. JobError SCAN_FAILED when there is no map."""
        request = FinishScan.Request(scan_id=scan_id, until=time_to_msg(until))
        response = self._call(self._finish, request, Code.SCAN_FAILED, self.timeout + 10.0)
        return convert.scan_from_msg(response.map)

    def correct(self, job_id: str, request: CorrectionRequest) -> Correction:
        """JobError UNKNOWN when the request is refused, NODE_LOST without an answer."""
        message = convert.correction_request(job_id, request, self._stamp())
        answer = self._call(self._correct, message, Code.UNKNOWN)
        return convert.correction_from_msg(answer.correction, answer.learned)

    def setpoints(self, job_id: str, request: FeedRequest) -> list[Segment]:
        """JobError PLAN_FAILED when the request is refused, NODE_LOST without an answer."""
        message = convert.feed_request(job_id, request)
        response = self._call(self._feed, message, Code.PLAN_FAILED)
        return [segment_from_msg(s) for s in response.segments]

    def record(self, start: bool, directory: str, custom: tuple[str, ...] = ()) -> str:
        """Starts or stops the recording in this folder; the recorder ends it by itself when this node dies. A missing
        recorder is an error: a job without a record cannot be traced."""
        code = Record.Request.START if start else Record.Request.STOP
        request = Record.Request(code=code, directory=directory)
        if start:
            request.custom_data = [*custom, f'client={self.node.process}']
        try:
            silence = self._silence_of(self._record)
            response = call(self._record, request, self.timeout + 10.0, silence)
        except CallError as e:
            raise JobError(Code.NODE_LOST, str(e)) from None
        if not response.success:
            raise JobError(Code.NODE_LOST, f'recorder: {response.message}')
        return response.message

    # ---- publishing ----------------------------------------------------------------------------

    def _stamp(self) -> Time:
        return self.node.get_clock().now().to_msg()

    def plan(self, job_id: str, layer: int, segments: list[Segment]) -> None:
        """Publishes layer_plan and, for a pyrometer that can be aimed, the place to look at (pyrometer_aim)."""
        path = [segment_to_msg(s) for s in segments]
        message = to_msg(
            LayerPlan, stamp=self._stamp(), frame='work', job_id=job_id, layer=layer, segments=path
        )
        self._plan.publish(message)
        point = aim_point(segments)
        if point is not None:  # a pyrometer that can be aimed follows the metal
            zero = self.machine().work_offset
            self._aim.publish(convert.aim_to_msg(point, zero, message.header.stamp))

    def next_layer(self, job_id: str, coming: model.NextLayer) -> None:
        """Publishes next_layer."""
        self._next.publish(convert.next_layer_to_msg(job_id, coming, self._stamp()))

    def status(self, status: Status) -> None:
        """Publishes job_status; telemetry is counted to the layer while it is laid."""
        self.job_id = status.job_id
        with self._lock:
            self._stats.layer = status.layer if status.state == State.DEPOSITING else 0
        self._status.publish(to_msg(JobStatus, status, stamp=self._stamp()))

    def layer_report(self, report: LayerRecord) -> None:
        """Publishes layer_report."""
        self._report.publish(to_msg(LayerReport, report, stamp=self._stamp()))

    def anomaly(self, anomaly: AnomalyRecord) -> None:
        """Publishes anomaly; `take_warnings` will not return it."""
        self._own.append(anomaly.text)
        self._anomaly.publish(convert.anomaly_to_msg(anomaly, self.job_id))
