"""A sweep on the running graph: the machine goes to the probe point, swings, and the accelerometer is listened to."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from waam_calibrate.graph import Settings
from waam_calibrate.resonance import SEGMENT, Samples
from waam_calibrate.results import ACCEL, told_by
from waam_calibrate.sweep import Sweep
from waam_msgs.msg import AccelerationBatch, SegmentDone, Telemetry
from waam_msgs.srv import Command, Enqueue
from waam_node.conversions import segment_to_msg
from waam_node.qos import BEAT, EVENTS, TELEMETRY
from waam_process.names import POWER_UP
from waam_process.segment import Kind, Point, Segment

from .client import ClientError, GraphClient
from .progress import bar

TRAVEL = 0.05  # m/s, to the probe point
BATCH = 500  # segments of a request
HOMING_S, SILENT_S = 900.0, 20.0
CELL_S = 180.0  # until a simulated cell that compiles has met the controller
ALARM_S = 5.0  # until a reset shows in the state: a command is refused by what the bridge has heard
REST = 1.5 * SEGMENT  # s of samples before the motion
NAME = 'calibration'


class Shaking(GraphClient):
    """Use as a context manager."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.telemetry: Telemetry | None = None
        self.done = -1
        self.blocks: list[AccelerationBatch] = []
        node = self.node
        node.create_subscription(Telemetry, 'telemetry', self._on_telemetry, TELEMETRY)
        node.create_subscription(SegmentDone, 'segment_done', self._on_done, EVENTS)
        # as deep as telemetry: a simulated minute is over in seconds, and none of them may be lost
        node.create_subscription(AccelerationBatch, 'acceleration', self.blocks.append, TELEMETRY)

    def __enter__(self) -> Shaking:
        return self

    def _on_telemetry(self, message: Telemetry) -> None:
        self.telemetry = message

    def _on_done(self, message: SegmentDone) -> None:
        if message.job_id.startswith(NAME):
            self.done = max(self.done, message.index)

    @property
    def here(self) -> Point:
        """m, work frame. ClientError without telemetry."""
        self.until(lambda: self.telemetry is not None, 10.0)
        if self.telemetry is None:
            raise ClientError('no telemetry: is the controller there? (waam status)')
        p = self.telemetry.position
        return p.x, p.y, p.z

    def command(self, code: int, text: str = '', value: float = 0.0) -> str:
        """ClientError when the bridge or the controller refuses."""
        request = Command.Request(code=code, text=text, value=value)
        answer = self.call(Command, 'bridge/command', request)
        if answer.error_code:
            raise ClientError(f'{answer.message} (error {answer.error_code})')
        return answer.message

    def configure(self, settings: Settings) -> str:
        """Settings of the controller, in this order; its last answer."""
        said = ''
        for name, value in settings:
            said = self.command(Command.Request.CONFIGURE, name, value)
        return said

    def told(self) -> dict[str, float]:
        """Settings that the controller has, see `waam_calibrate.results.told_by`."""
        return told_by(self.command(Command.Request.SETTINGS))

    def ready(self) -> None:
        """Homed and in IDLE. ClientError while a job runs, and in any ALARM but that of a controller that was just
        switched on: what else has ended the motion is for a person to see to."""
        if job := self.running_job():
            raise ClientError(f'a job is running: {job.job_id} (waam status, waam job abort)')
        self.until(lambda: self.machine is not None, 10.0)
        if self.machine is None or not self.machine.connected:
            raise ClientError('the controller does not answer (waam status)')
        if self.machine.state == Telemetry.STATE_ALARM:
            if self.machine.fault != POWER_UP:
                text = f'the machine is in ALARM: {self.machine.fault_text}'
                raise ClientError(f'{text}; see to it, then Reset and Home on the panel')
            self.command(Command.Request.RESET)
            if not self.until(self._reset, ALARM_S):
                raise ClientError(f'the machine stays in ALARM: {self.machine.fault_text}')
        if not self.machine.homed:
            self.command(Command.Request.HOME)
        if not self.until(self._rests, HOMING_S):
            raise ClientError(f'the machine does not come to rest: {self.machine.message}')

    def meet_cell(self) -> None:
        """The accelerometer of a simulated cell answers only once the cell, which may still compile, has met the
        controller: then its clock runs. ClientError when it does not."""
        node = self.node
        ticks: list[Clock] = []
        clock = node.create_subscription(Clock, '/clock', ticks.append, BEAT)
        try:
            if not self.until(lambda: ticks, CELL_S):
                raise ClientError('the simulated cell has not met the controller (waam status)')
        finally:
            node.destroy_subscription(clock)

    def _reset(self) -> bool:
        return self.machine is not None and self.machine.state != Telemetry.STATE_ALARM

    def _rests(self) -> bool:
        m = self.machine
        return m is not None and m.homed and m.state == Telemetry.STATE_IDLE

    def takes_settings(self) -> bool:
        """A controller that moves refuses them."""
        m = self.machine
        return m is not None and m.state in (Telemetry.STATE_IDLE, Telemetry.STATE_ALARM)

    def listen(self, on: bool) -> None:
        """Switches the accelerometer. ClientError with what it says when it refuses."""
        answer = self.call(SetBool, 'accelerometer/enable', SetBool.Request(data=on))
        if not answer.success:
            hint = 'the simulated cell has one with its parameter gantry_on (waam up --params-file)'
            raise ClientError(f'the accelerometer: {answer.message}; {hint}')

    def enqueue(self, segments: list[Segment], job: str) -> None:
        """ClientError when the bridge refuses a segment; then none of the batch was taken."""
        for k in range(0, len(segments), BATCH):
            request = Enqueue.Request(job_id=job, last=False)
            request.segments = [segment_to_msg(s) for s in segments[k : k + BATCH]]
            answer = self.call(Enqueue, 'bridge/enqueue', request)
            if answer.error_code:
                raise ClientError(f'bridge/enqueue: {answer.message} (error {answer.error_code})')

    def wait_done(self, index: int, progress: Any = None) -> None:
        """Until the segment is done; ClientError when nothing is done for a while."""
        while self.done < index:
            before = self.done
            if not self.until(lambda: self.done > before, SILENT_S):  # noqa: B023
                state = self.machine.message if self.machine else ''
                raise ClientError(f'the machine stopped at move {before} of {index}: {state}')
            if progress is not None:
                progress(self.done)

    def received(self) -> int:
        """Samples so far."""
        return sum(len(b.x) for b in self.blocks)


def shake(
    domain: int, sweep: Sweep, axis: str, point: Point | None, simulated: bool = False
) -> Samples:
    """The samples of a sweep, without the shaper of the axis and with the acceleration of the machine; its own are in
    force again afterwards. simulated: the accelerometer is that of a cell. ClientError when something refuses or does
    not answer."""
    with Shaking(domain) as graph:
        if simulated:
            graph.meet_cell()
        graph.ready()
        with unshaped(graph, axis):
            return swing(graph, sweep, axis, point)


@contextlib.contextmanager
def unshaped(graph: Shaking, axis: str) -> Iterator[None]:
    """The axis without its shaper and with the acceleration of the machine; afterwards its own are in force again. What
    fails inside, or is interrupted, stops the machine first. One that does not come to rest stays so; the list of
    alarms says it."""
    told, shape, accel, limit = graph.told(), f'shape_{axis}', ACCEL + axis, f'accel_limit_{axis}'
    before = [(shape, told.get(shape, 0.0))]
    swinging = [(shape, 0.0)]
    if accel in told and limit in told:  # older firmware has neither
        before = [(accel, told[accel]), *before]
        swinging.append((accel, told[limit]))
    try:
        graph.configure(swinging)
        yield
    except BaseException:
        with contextlib.suppress(ClientError):
            graph.command(Command.Request.STOP)
        raise
    finally:
        graph.until(graph.takes_settings, SILENT_S)
        with contextlib.suppress(ClientError):
            graph.configure(before)


def swing(graph: Shaking, sweep: Sweep, axis: str, point: Point | None) -> Samples:
    """The samples of the moves of a sweep that begin at the step next to the point (None = where the torch is; m, work
    frame)."""
    here = graph.here
    assert graph.machine is not None
    zero = graph.machine.work_offset
    point = sweep.on_step(point or here, axis, (zero.x, zero.y, zero.z))
    job = f'{NAME}_{graph.node.get_clock().now().nanoseconds}'
    way = approach(here, point)
    graph.enqueue(way, job)
    graph.wait_done(way[-1].index)
    graph.listen(True)
    try:
        rest = _rest(graph)
        moves = sweep.segments(axis, point, len(way))
        with bar(f'sweep of {axis}', len(moves)) as progress:
            graph.enqueue(moves, job)
            graph.wait_done(moves[-1].index, progress)
        begun = len(rest)
    finally:
        graph.listen(False)
    graph.until(lambda: False, 0.3)
    return _samples(graph.blocks, rest, begun)


def approach(here: Point, point: Point) -> list[Segment]:
    """Up to the higher of both, across, down; m, work frame."""
    top = max(here[2], point[2])
    stops = [here, (here[0], here[1], top), (point[0], point[1], top), point]
    return [
        Segment(i, Kind.IDLE, a, b, TRAVEL)
        for i, (a, b) in enumerate(zip(stops, stops[1:], strict=False))
    ]


def _rest(graph: Shaking) -> list[AccelerationBatch]:
    """Blocks before the motion; the list of the graph goes on behind them."""

    def enough() -> bool:
        blocks = graph.blocks
        return bool(blocks) and graph.received() >= REST * blocks[0].sample_rate

    if not graph.until(enough, 60.0):
        raise ClientError('no samples came from the accelerometer (topic acceleration)')
    return list(graph.blocks)


def _samples(blocks: list[AccelerationBatch], rest: list[AccelerationBatch], begun: int) -> Samples:
    moved = blocks[begun:]
    if not moved:
        raise ClientError('no samples came from the accelerometer during the sweep')
    size = len(moved[0].x)
    lost = size * sum(
        max(0, b.sequence - a.sequence - 1) for a, b in zip(blocks, blocks[1:], strict=False)
    )
    return Samples(_values(moved), _values(rest), moved[0].sample_rate, moved[0].range, lost)


def _values(blocks: list[AccelerationBatch]) -> np.ndarray:
    """(n, 3) m/s^2."""
    return np.concatenate([np.stack([b.x, b.y, b.z], axis=1) for b in blocks]).astype(float)
