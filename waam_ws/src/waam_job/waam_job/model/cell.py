"""What the job needs from the rest of the graph, as one interface: ros_cell.py on ROS, fakes in the tests.

All calls come from the job's thread and may block; each raises JobError when it fails. SI units, work frame.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from waam_process.grid import GridSpec
from waam_process.segment import Point, Segment

from .records import AnomalyRecord, LayerRecord, Status
from .snapshots import Correction, CorrectionRequest, Heat, Machine, Scan, Sums

__all__ = ['Cell', 'Correction', 'CorrectionRequest', 'Heat', 'Machine', 'Scan', 'Sums']


class Cell(Protocol):
    """The graph as the job sees it."""

    def now(self) -> float: ...
    def machine(self) -> Machine: ...
    def heat(self) -> Heat: ...
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Effective parameters of the other nodes by their names; a node that did not answer is missing."""

    def wait(self, seconds: float) -> None:
        """Lets `seconds` of wall time pass."""

    def command(
        self,
        name: str,
        *,
        text: str = '',
        names: tuple[str, ...] = (),
        vector: Point = (0, 0, 0),
        value: float = 0.0,
    ) -> None: ...
    def enqueue(self, job_id: str, segments: list[Segment], last: bool) -> None: ...
    def begin_scan(self, job_id: str, layer: int, spec: GridSpec) -> int: ...
    def finish_scan(self, scan_id: int, until: float) -> Scan: ...
    def correct(self, job_id: str, request: CorrectionRequest) -> Correction: ...
    def setpoints(
        self,
        job_id: str,
        material: str,
        segments: list[Segment],
        correction: Correction | None,
        heat_factor: float,
        apply: bool,
    ) -> list[Segment]: ...
    def record(self, start: bool, directory: str, custom: tuple[str, ...] = ()) -> str: ...
    def plan(self, job_id: str, layer: int, segments: list[Segment]) -> None: ...
    def take_warnings(self) -> list[AnomalyRecord]:
        """Those of severity WARNING that other nodes published since the last call."""

    def take_sums(self) -> Sums: ...
    def take_track(self) -> dict[str, np.ndarray]: ...
    def status(self, status: Status) -> None: ...
    def layer_report(self, report: LayerRecord) -> None: ...
    def anomaly(self, anomaly: AnomalyRecord) -> None: ...
