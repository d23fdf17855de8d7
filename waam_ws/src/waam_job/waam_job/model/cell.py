"""What the job needs from the rest of the graph, as one interface; the ROS side is ros_cell.py, tests bring their own.

All calls come from the job's thread and may block; each raises JobError when it fails. SI units, work frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Point, Segment


@dataclass(frozen=True)
class Machine:
    """Snapshot of controller and link. age: s of wall time since the last telemetry frame."""

    connected: bool = False
    age: float = float('inf')
    state: str = 'IDLE'
    homed: bool = False
    armed_job: str = ''
    arc_on: bool = False
    fault: int = 0
    fault_text: str = ''
    silent_nodes: tuple[str, ...] = ()
    message: str = ''
    position: Point = (0.0, 0.0, 0.0)
    executed: int = -1  # index of the last segment done
    executed_job: str = ''
    limit_min: Point = (0.0, 0.0, 0.0)
    limit_max: Point = (0.0, 0.0, 0.0)
    work_offset: Point = (0.0, 0.0, 0.0)  # zero of the work frame in machine coordinates
    identity: str = ''
    firmware: str = ''
    port: str = ''


@dataclass(frozen=True)
class Heat:
    """Snapshot of the thermal compensator."""

    known: bool = False
    factor: float = 1.0
    temperature: float = float('nan')
    limit: float = float('nan')
    ready: bool = False
    wait: float = float('nan')
    plausible: bool = False
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True)
class Scan:
    """A finished map and its quality."""

    map: HeightGrid
    count: np.ndarray
    coverage: float
    plausible: bool
    reasons: tuple[str, ...] = ()
    profiles_used: int = 0
    profiles_rejected: int = 0
    points_used: int = 0
    points_rejected: int = 0
    stamp: float = float('nan')  # s, ROS time of the last profile; NaN = not known
    handle: object = None  # the message, handed on to the correction server


@dataclass(frozen=True)
class Correction:
    """What the correction server answered for one layer; maps are (rows, cols)."""

    psi: np.ndarray
    confidence: np.ndarray
    residual_height: np.ndarray
    k_gain: float
    flow_factor: float
    law: str
    fallback: bool
    reasons: tuple[str, ...]
    saturated_cells: int
    model_hash: str = ''  # of the weights, '' for explicit laws
    handle: object = None


@dataclass(frozen=True)
class CorrectionRequest:
    """Surface, target and history for the correction server; maps (rows, cols) in m on the scan's grid.

    beads: (n, 2) x, y in m of every stretch from arc on to arc off, in the order they are laid."""

    layer: int
    scan: Scan
    target: np.ndarray
    planned: np.ndarray
    previous_growth: np.ndarray | None
    previous_surface: np.ndarray | None
    previous_feed_factor: float
    bead_width: float
    temperature: float
    k_gain: float
    direction: tuple[float, float]
    beads: tuple[np.ndarray, ...] = ()


@dataclass
class Sums:
    """Running sums over telemetry since the last `take`: what a layer report needs."""

    frames: int = 0
    arc_frames: int = 0
    current: float = 0.0
    voltage: float = 0.0
    wire: float = 0.0
    speed: float = 0.0
    power_per_speed: float = 0.0  # sum of I*U/V, J/m
    current_error_sq: float = 0.0
    arc_starts: int = 0
    lost: int = 0
    frame_period: float = 0.01


class Cell(Protocol):
    """The graph as the job sees it."""

    def now(self) -> float: ...
    def machine(self) -> Machine: ...
    def heat(self) -> Heat: ...
    def parameters(self) -> dict[str, dict]:
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
    def take_warnings(self) -> list:
        """AnomalyRecords of severity WARNING that other nodes published since the last call."""

    def take_sums(self) -> Sums: ...
    def take_track(self) -> dict[str, np.ndarray]: ...
    def status(self, status: object) -> None: ...
    def layer_report(self, report: object) -> None: ...
    def anomaly(self, anomaly: object) -> None: ...
