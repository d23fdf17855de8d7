"""Shows the cell live in rerun, keeps job.rrd of every job and writes its report. Callbacks only hand over; threads
do the work."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from waam_msgs.msg import HeightMap, JobStatus
from waam_node.conversions import nanoseconds
from waam_node.node import OK, WARN, WaamNode
from waam_node.node import main as run_main
from waam_node.params import param
from waam_node.qos import EVENTS, LATCHED, SENSOR
from waam_process.names import job_state

from . import conversions as cv
from .drawing import Drawing
from .node_layers import LayerTopics
from .node_tap import TelemetryTap
from .report_writer import ReportWriter
from .scene import Scene

QOS = {'temperature': SENSOR, 'layer_report': EVENTS, 'anomaly': EVENTS}  # all others are latched
NICE = 10  # where cores are scarce the nodes of the loop come first


@dataclass(frozen=True)
class DashboardParams:
    """Parameters of the node, with default, meaning, unit and limits."""

    grpc_port: int = param(9876, 'rerun server on 127.0.0.1; 0 = none', '', 0, 65535)
    web_port: int = param(0, 'web viewer on 127.0.0.1; 0 = none', '', 0, 65535)
    error_range: float = param(
        0.0006, 'height error at the ends of the colour scale', 'm', 1e-5, 0.1
    )


class Dashboard(WaamNode):
    """Not required by the arc lease; draws in a thread of its own."""

    def __init__(self) -> None:
        super().__init__('dashboard', DashboardParams)
        p = self.params
        self._drawing = Drawing(Scene(p.error_range), p.grpc_port, p.web_port)
        log = self.get_logger()
        self._reports = ReportWriter(log.info, log.warning)
        self._job = ''
        self._messages = cv.MessageDrawing()
        self._samples = cv.Samples()
        self._tap = TelemetryTap(self, '_dashboard_tap')
        self.create_timer(0.02, self._poll_telemetry, clock=self.steady)
        self.create_timer(1.0, self._report, clock=self.steady)
        for topic, kind in cv.TYPES.items():
            qos = QOS.get(topic, LATCHED)
            self.create_subscription(kind, topic, partial(self._on_message, topic), qos)
        self._layers = LayerTopics(self)

    def _poll_telemetry(self) -> None:
        for sample in filter(None, map(self._samples.of, self._tap.take())):
            self._drawing.telemetry(sample)

    def _on_message(self, topic: str, msg: Any) -> None:
        if topic == 'job_status':
            self._begin_job(msg)
        draw = self._messages.of(topic, msg)
        if topic in cv.NEWEST:
            self._drawing.newest(topic, draw)
        else:
            self._drawing.put(draw)
        match msg:
            case HeightMap():
                self._drawing.expect_error(msg.layer, lambda: cv.map_data(msg))
            case JobStatus():
                self._end_job(msg)

    def _begin_job(self, msg: JobStatus) -> None:
        running = msg.state != JobStatus.IDLE and msg.state not in cv.ENDED
        if msg.job_dir and msg.job_dir != self._job and running:
            self._job = msg.job_dir
            self._drawing.start_job(Path(msg.job_dir))
            self._reports.begin(Path(msg.job_dir))

    def _end_job(self, msg: JobStatus) -> None:
        if msg.state not in cv.ENDED:
            return
        if msg.job_dir:
            self._reports.end(Path(msg.job_dir))
        if msg.job_dir == self._job:
            self._job = ''
            t, said = nanoseconds(msg.header.stamp), f'job {job_state(msg.state).lower()}'
            self._drawing.put(lambda scene: scene.text(t, 0, f'{said}: {msg.message}'))
            self._drawing.end_job()

    def _report(self) -> None:
        drawing = self._drawing
        self.values = {
            'viewer': drawing.url, 'file': drawing.file, 'drawn': drawing.drawn,
            'dropped': drawing.mailbox.dropped, 'maps_skipped': drawing.mailbox.replaced,
            'longest_draw_ms': f'{drawing.longest_s * 1e3:.0f}',
        }  # fmt: skip
        self.values['report'] = self._reports.last
        problem = drawing.problem or self._reports.problem
        self.level = WARN if problem or drawing.mailbox.dropped else OK
        self.message = problem or 'ok'

    def close(self) -> None:
        """Finishes report and drawing, each within a bounded time."""
        self._reports.close()
        self._drawing.close()
        self._tap.close()


def main() -> None:
    """The node as a process, at a lower priority (NICE) than the ones that control the cell."""
    os.nice(NICE)
    run_main(Dashboard)
