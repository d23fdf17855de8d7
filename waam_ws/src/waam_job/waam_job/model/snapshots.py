"""What the job sees of machine, temperature, scans and corrections at one moment. SI units, work frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Point, Segment

HEAT_SILENT = 10.0  # s after which the last word of the thermal compensator, which speaks twice a second, is too old


@dataclass(frozen=True)
class Machine:
    """Snapshot of controller and link."""

    connected: bool = False
    age: float = float('inf')  # s of wall time since the last telemetry frame
    state: str = 'IDLE'  # IDLE, RUN, HOLD, ALARM
    homed: bool = False
    armed_job: str = ''
    arc_on: bool = False
    fault: int = 0
    fault_text: str = ''
    silent_nodes: tuple[str, ...] = ()
    message: str = ''
    position: Point = (0.0, 0.0, 0.0)
    position_at: float = float('inf')  # s of ROS time of the telemetry that brought it
    burned: Point | None = None  # m, work frame: where current flowed last; None = it never did
    executed: int = -1  # index of the last segment done
    executed_job: str = ''
    limit_min: Point = (0.0, 0.0, 0.0)
    limit_max: Point = (0.0, 0.0, 0.0)
    work_offset: Point = (0.0, 0.0, 0.0)  # zero of the work frame in machine coordinates
    state_at: float = (
        0.0  # s of ROS time of the machine_state that brought it and the fields beside it
    )
    identity: str = ''
    firmware: str = ''
    port: str = ''


@dataclass(frozen=True)
class Heat:
    """Snapshot of the thermal compensator."""

    known: bool = False  # a message of it has arrived
    factor: float = 1.0  # eq 2.19: feed is multiplied by it
    temperature: float = float('nan')  # degC, filtered
    limit: float = float('nan')  # degC, interpass
    ready: bool = False  # below the limit
    wait: float = float('nan')  # s until ready, NaN = unknown
    plausible: bool = False  # the readings of the pyrometer are plausible
    reasons: tuple[str, ...] = ()  # why not plausible
    believed: bool = True  # the temperature answers to the layers that are laid
    doubt: str = ''  # why not believed

    def heard(self, age: float) -> Heat:
        """The same `age` s after it was said: a node that is silent says nothing of now, and no old reason is the
        cause."""
        if not self.known or age <= HEAT_SILENT:
            return self
        reason = f'thermal_compensator has said nothing for {age:.0f} s'
        return replace(self, ready=False, plausible=False, wait=math.nan, reasons=(reason,))


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
    # of the beads laid last where they stand free, m: mean, its standard uncertainty, what was expected; NaN = none
    bead_width: float = float('nan')
    bead_width_u: float = float('nan')
    bead_width_expected: float = float('nan')
    stored: bool = False  # read from the folder of an interrupted job
    extent: str = ''  # what the pass covered and why, in words; '' = the whole part, as always
    job_id: str = ''  # that its message names; '' = it came without one
    layer: int = -1  # layers laid before it, as its message names; -1 = it came without one
    handle: object = None  # the message, handed on to the correction server


@dataclass(frozen=True)
class LaidBeads:
    """The beads that were laid last, for the measurement of their width. Of each stretch from arc on to arc off: the
    path (n, 2) m and, for each point, the width (n,) m that the material table expects of the piece that ends there."""

    paths: tuple[np.ndarray, ...] = ()
    widths: tuple[np.ndarray, ...] = ()


@dataclass(frozen=True)
class Correction:
    """What the correction server answered for one layer; maps are (rows, cols)."""

    psi: np.ndarray  # -1..1, wanted change of the travel speed
    confidence: np.ndarray  # 0..1
    residual_height: np.ndarray  # m, what psi cannot give within its authority
    k_gain: float  # authority of the speed correction
    flow_factor: float  # identified efficiency of the wire
    law: str  # name of the correction law
    fallback: bool  # the law that was asked for could not be used
    reasons: tuple[str, ...]  # for the fallback, and remarks
    saturated_cells: int  # grid cells where psi is at its limit
    model_hash: str = ''  # of the weights, '' for explicit laws
    width_ratio: float = 0.0  # measured over expected bead width; 0 = the voltage is not moved
    # m, of the surface after the layer: expected, and its 90 % interval; 0 = nothing can be said
    expected_rms: tuple[float, float, float] = (0.0, 0.0, 0.0)
    learned: str = ''  # by former jobs and this one (waam_process.learned), '' = none
    handle: object = None


@dataclass(frozen=True)
class CorrectionRequest:
    """Surface, target and history for the correction server; maps (rows, cols) in m on the scan's grid."""

    layer: int
    scan: Scan  # the surface before the layer
    target: np.ndarray  # wanted surface before the layer, NaN = do not care
    planned: np.ndarray  # metal of the layer
    previous_growth: np.ndarray | None  # metal that the layer before was asked for
    previous_surface: np.ndarray | None  # surface before the layer before
    previous_feed_factor: float  # of the feed of the layer before, flow times heat
    bead_width: float  # m
    temperature: float  # degC
    k_gain: float  # NaN = the server's own
    direction: tuple[float, float]  # of travel, unit vector
    # Each (n, 2): x, y in m from arc on to arc off, in the order they are laid.
    beads: tuple[np.ndarray, ...] = ()
    heat_factor: float = 1.0  # eq 2.19: feed of this layer will be multiplied by it
    learned: str = ''  # by former jobs (waam_process.learned), '' = none
    ratio_high: float = 0.0  # see Plan
    next_thickness: float = 0.0  # m, median of the metal of the layer after this one, 0 = none


@dataclass(frozen=True)
class NextLayer:
    """What the plan says of the layer that will be asked for next, before its surface is known."""

    layer: int
    spec: GridSpec  # of planned
    planned: np.ndarray  # (rows, cols) m, metal of the layer
    bead_width: float  # m
    direction: tuple[float, float]  # of travel, unit vector
    beads: tuple[np.ndarray, ...]  # as in CorrectionRequest


@dataclass(frozen=True)
class FeedRequest:
    """Path of one layer and what decides over its speeds and feeds, for the feed-forward."""

    material: str
    segments: list[Segment]
    correction: Correction | None  # None = nominal setpoints
    heat_factor: float  # eq 2.19
    apply: bool  # False = the correction is only recorded


@dataclass
class Sums:
    """Running sums over telemetry since the last `take`: what a layer report needs."""

    frames: int = 0
    arc_frames: int = 0  # frames with a burning arc; the sums are over these
    current: float = 0.0  # A
    voltage: float = 0.0  # V
    wire: float = 0.0  # m/s
    speed: float = 0.0  # m/s
    power_per_speed: float = 0.0  # I*U/V, J/m
    current_sq: float = 0.0  # sum of I^2, A2
    # g = feed commanded^0.65, which the set current goes with: sums of I*g and of g^2.
    current_feed: float = 0.0
    feed_sq: float = 0.0
    arc_starts: int = 0
    lost: int = 0  # frames missing in the sequence
    frame_period: float = 0.01  # s
