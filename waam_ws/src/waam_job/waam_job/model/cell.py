"""What the job needs from the rest of the graph, as one interface: ros_cell.py on ROS, fakes in the tests.

All calls come from the job's thread and may block; each raises JobError when it fails. SI units, work frame.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from waam_process.grid import GridSpec
from waam_process.segment import Point, Segment

from .records import AnomalyRecord, LayerRecord, Status
from .snapshots import (
    Correction,
    CorrectionRequest,
    FeedRequest,
    Heat,
    LaidBeads,
    Machine,
    NextLayer,
    Scan,
    Sums,
)

__all__ = [
    'Cell',
    'Correction',
    'CorrectionRequest',
    'FeedRequest',
    'Heat',
    'LaidBeads',
    'Machine',
    'NextLayer',
    'Scan',
    'Sums',
]


class Cell(Protocol):
    """The graph as the job sees it."""

    def now(self) -> float:
        """ROS time, s."""

    def wait(self, seconds: float) -> None:
        """Lets `seconds` of wall time pass."""

    # ---- what the cell tells

    def machine(self) -> Machine:
        """Controller and link as they were last heard of."""

    def heat(self) -> Heat:
        """Temperature and heat factor as they were last heard of."""

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Effective parameters of the other nodes by their names; a node that did not answer is missing."""

    def take_warnings(self) -> list[AnomalyRecord]:
        """Those of severity WARNING that other nodes published since the last call."""

    def take_sums(self) -> Sums:
        """Sums over the telemetry since the last call."""

    def take_track(self) -> dict[str, np.ndarray]:
        """Telemetry since the last call: columns (n,) by name, SI."""

    # ---- what the job asks for

    def command(
        self,
        name: str,
        *,
        text: str = '',
        names: tuple[str, ...] = (),
        vector: Point = (0, 0, 0),
        value: float = 0.0,
    ) -> None:
        """A command to the bridge, by the name of its constant in Command.srv, such as 'ARM'; SI.

        Returns when the bridge has answered.
        """

    def enqueue(self, job_id: str, segments: list[Segment], last: bool) -> None:
        """Hands segments to the bridge, all or none; last: the queue may run empty after them."""

    def begin_scan(self, job_id: str, layer: int, spec: GridSpec, laid: LaidBeads) -> int:
        """Switches the scanner on and begins a map after `layer` layers. Returns the number of the scan.

        laid: what is new since the map before, so that the map tells its bead width.
        """

    def finish_scan(self, scan_id: int, until: float) -> Scan:
        """The map of all profiles up to ROS time `until`, s."""

    def correct(self, job_id: str, request: CorrectionRequest) -> Correction:
        """Psi, residual height and flow factor for a layer."""

    def setpoints(self, job_id: str, request: FeedRequest) -> list[Segment]:
        """The segments with speed, feed, voltage and psi filled in."""

    def record(self, start: bool, directory: str, custom: tuple[str, ...] = ()) -> str:
        """Starts or stops the recording in a folder; custom: 'key=value', kept with it. Returns its words."""

    # ---- what the job tells

    def plan(self, job_id: str, layer: int, segments: list[Segment]) -> None:
        """The path of the layer that is laid next; a pyrometer that can be aimed follows it."""

    def next_layer(self, job_id: str, coming: NextLayer) -> None:
        """The layer after the one that is being laid, so that its correction can be prepared meanwhile."""

    def status(self, status: Status) -> None:
        """Where the job stands."""

    def layer_report(self, report: LayerRecord) -> None:
        """What a layer has become."""

    def anomaly(self, anomaly: AnomalyRecord) -> None:
        """Something that an operator should know of."""
