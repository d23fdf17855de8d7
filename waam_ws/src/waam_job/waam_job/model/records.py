"""What a job says about itself: status, layer report, anomaly. Fields are those of the messages of the same name."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from enum import IntEnum

import numpy as np

from waam_process.loop_mode import with_loop_mode
from waam_process.segment import Clamp, Kind, Segment

from .snapshots import Correction, Scan, Sums

GONE = 'in_layer_'  # how fields of older records begin that nothing reads any more
ALPHA_HEIGHT, ALPHA_CURRENT = 1.0, 1e-4  # weights of eq 2.4, 1/mm2 and 1/A2


class State(IntEnum):
    """Phases of a job; numbers as in waam_msgs/JobStatus."""

    IDLE = 0
    VALIDATING = 1
    PREPARING = 2
    COOLING = 3
    SCANNING = 4
    CORRECTING = 5
    DEPOSITING = 6
    PAUSED = 7
    FINISHING = 8
    DONE = 9
    FAILED = 10
    ABORTED = 11


@dataclass
class Status:
    """waam_msgs/JobStatus without the header."""

    job_id: str = ''
    job_dir: str = ''
    state: State = State.IDLE
    loop_mode: str = ''
    material: str = ''
    k_gain: float = math.nan
    pass_number: int = 0
    passes: int = 1
    layer: int = 0
    layers: int = 0
    bead: int = 0
    beads: int = 0
    progress: float = 0.0
    time_left: float = math.nan
    height_error_rms: float = math.nan
    height_error_max: float = math.nan
    error_code: int = 0
    message: str = ''


def _without_nulls(data: dict) -> dict:
    return {k: math.nan if v is None else v for k, v in data.items()}


@dataclass(frozen=True)
class AnomalyRecord:
    """waam_msgs/Anomaly; time in s (ROS time), position in m (work frame)."""

    time: float
    severity: str
    class_name: str
    text: str
    reaction: str
    layer: int = 0
    bead: int = 0
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def to_json(self) -> dict:
        """As in report.json, where the name of the class is `class`."""
        data = asdict(self)
        data['class'] = data.pop('class_name')
        return data

    @classmethod
    def from_json(cls, data: dict) -> AnomalyRecord:
        """From `dataclasses.asdict` that went through JSON."""
        return cls(**{**_without_nulls(data), 'position': tuple(data['position'])})


@dataclass
class LayerRecord:
    """waam_msgs/LayerReport without the header; SI."""

    job_id: str = ''
    loop_mode: str = ''
    layer: int = 0
    pass_number: int = 1
    final: bool = False
    duration: float = 0.0
    wait: float = 0.0
    temperature: float = math.nan
    current_mean: float = 0.0
    voltage_mean: float = 0.0
    wire_feed_mean: float = 0.0
    travel_speed_mean: float = 0.0
    heat_input: float = 0.0
    energy: float = 0.0
    wire_used: float = 0.0
    arc_on_time: float = 0.0
    arc_starts: int = 0
    height_error_rms: float = math.nan
    height_error_max: float = math.nan
    height_error_mean: float = math.nan
    coverage: float = 0.0
    psi_min: float = 0.0
    psi_mean: float = 0.0
    psi_max: float = 0.0
    k_gain: float = 0.0
    heat_factor: float = 1.0
    flow_factor: float = 1.0
    law: str = ''
    correction_applied: bool = False
    fallback: bool = False
    reasons: list[str] = field(default_factory=list)
    segments: int = 0
    clamps_speed: int = 0
    clamps_feed: int = 0
    clamps_voltage: int = 0
    clamps_psi: int = 0
    points_dropped: int = 0
    profiles_rejected: int = 0
    telemetry_lost: int = 0
    faults: int = 0
    cost: float = 0.0  # J of eq 2.4, see `add_height_cost`
    bead_width: float = math.nan
    bead_width_u: float = math.nan
    bead_width_expected: float = math.nan
    width_ratio: float = 0.0
    expected_rms: float = 0.0
    expected_rms_low: float = 0.0
    expected_rms_high: float = 0.0

    @classmethod
    def from_json(cls, data: dict) -> LayerRecord:
        """From `dataclasses.asdict` that went through JSON, where NaN is null. Of older jobs: without what corrected a
        layer while it was laid."""
        kept = {k: v for k, v in with_loop_mode(data).items() if not k.startswith(GONE)}
        return cls(**_without_nulls(kept))

    def add_errors(self, errors: np.ndarray) -> None:
        """Height errors (m, any shape, NaN ignored) of the surface before this layer (or after the last)."""
        known = errors[np.isfinite(errors)]
        if known.size:
            self.height_error_rms = float(np.sqrt(np.mean(known**2)))
            self.height_error_max = float(np.abs(known).max())
            self.height_error_mean = float(known.mean())

    def add_scan(self, scan: Scan) -> None:
        """Coverage, rejected points and profiles, bead width, and what the pass covered, of the scan before this layer
        (or after the last)."""
        self.reasons += [scan.extent] if scan.extent else []
        self.coverage = scan.coverage
        self.points_dropped = scan.points_rejected
        self.profiles_rejected = scan.profiles_rejected
        self.bead_width, self.bead_width_u = scan.bead_width, scan.bead_width_u
        self.bead_width_expected = scan.bead_width_expected

    def add_correction(
        self, correction: Correction | None, footprint: np.ndarray, applied: bool
    ) -> None:
        """footprint: (rows, cols) bool, where the layer lays metal."""
        self.correction_applied = applied and correction is not None
        if correction is None:
            return
        psi = correction.psi[footprint] if footprint.any() else np.zeros(1)
        self.psi_min, self.psi_mean, self.psi_max = (
            float(f(psi)) for f in (np.min, np.mean, np.max)
        )
        self.k_gain, self.law = correction.k_gain, correction.law
        self.fallback = correction.fallback
        self.reasons += list(correction.reasons)
        self.width_ratio = correction.width_ratio if applied else 0.0
        if applied:
            self.expected_rms, self.expected_rms_low, self.expected_rms_high = (
                correction.expected_rms
            )

    def add_segments(self, segments: list[Segment]) -> None:
        """Counts what was limited and keeps the factors that were really used."""
        deposit = [s for s in segments if s.kind == Kind.DEPOSIT]
        self.segments = len(deposit)
        self.clamps_speed = sum(
            bool(s.clamps & (Clamp.SPEED_LOW | Clamp.SPEED_HIGH)) for s in deposit
        )
        self.clamps_feed = sum(bool(s.clamps & (Clamp.FEED_LOW | Clamp.FEED_HIGH)) for s in deposit)
        self.clamps_voltage = sum(bool(s.clamps & Clamp.VOLTAGE) for s in deposit)
        self.clamps_psi = sum(bool(s.clamps & Clamp.PSI) for s in deposit)
        if deposit:
            self.heat_factor = float(np.mean([s.heat_factor for s in deposit]))
            self.flow_factor = float(np.mean([s.flow_factor for s in deposit]))

    def add_sums(self, sums: Sums, set_current: Callable[[float], float]) -> None:
        """Means over the frames with a burning arc. set_current: A that belong to a wire feed in m/s, 0 = not known."""
        self.telemetry_lost += sums.lost
        self.arc_starts = sums.arc_starts
        n, dt = sums.arc_frames, sums.frame_period
        if not n:
            return
        self.current_mean, self.voltage_mean = sums.current / n, sums.voltage / n
        self.wire_feed_mean, self.travel_speed_mean = sums.wire / n, sums.speed / n
        self.heat_input = sums.power_per_speed / n
        self.arc_on_time, self.wire_used = n * dt, sums.wire * dt
        self.energy = self.current_mean * self.voltage_mean * n * dt
        # at 1 m/s; it depends on the feed with the same exponent as `Sums.current_feed`
        wanted = set_current(1.0)
        if wanted:
            offset = sums.current_sq - 2 * wanted * sums.current_feed + wanted**2 * sums.feed_sq
            self.cost = ALPHA_CURRENT * max(offset, 0.0) * dt

    def add_height_cost(self, arc_time_before: float) -> None:
        """Completes the cost of eq 2.4, J = integral of alpha1*(H_ref - H_real)^2 + alpha2*(I_set - I_meas)^2 dt.

        The surface is known before the layer only. By the trapezoidal rule over all layers it counts for half of the
        layer before it (`arc_time_before` s, 0 = first) and half of its own; the final surface for half of the last.
        """
        error = 0.0 if math.isnan(self.height_error_rms) else self.height_error_rms * 1e3
        time = 0.5 * (arc_time_before + self.arc_on_time)
        self.cost += ALPHA_HEIGHT * error**2 * time
