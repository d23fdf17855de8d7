"""Records, snapshots and requests <-> messages."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped

from waam_msgs.action import RunJob
from waam_msgs.msg import Anomaly, CorrectionMap, HeatFactor, HeightMap, MachineState, NextLayer
from waam_msgs.srv import BeginScan, ComputeCorrection, ComputeFeed
from waam_node import job_folder
from waam_node.conversions import (
    from_msg,
    grid_from_msg,
    map_from_msg,
    plain,
    seconds,
    segment_to_msg,
    time_to_msg,
    to_msg,
)
from waam_process.grid import GridSpec, HeightGrid
from waam_process.loop_mode import with_loop_mode
from waam_process.names import CONTROLLER_STATES, SEVERITIES
from waam_process.operating import DEFAULT_MATERIAL

from .model import cell
from .model.cell import Correction, CorrectionRequest, FeedRequest, Heat, Scan
from .model.goal import JobGoal
from .model.records import AnomalyRecord

STATES = CONTROLLER_STATES
TEMPERATURES = (-50.0, 2000.0)  # degC, of a part that is laid on
NUMBERS = ('layer_height', 'bead_width', 'tolerance', 'scale')  # of a goal: 0 or NaN = as usual
HEAT_FACTORS = (0.1, 1.0)  # of eq 2.19


def goal_from_msg(msg: RunJob.Goal, default_jobs_dir: str) -> JobGoal:
    """Empty fields take their defaults."""

    def number(value: float, default: float) -> float:
        return default if math.isnan(value) or value == 0.0 else value

    jobs = Path(msg.jobs_dir or default_jobs_dir)
    return from_msg(
        JobGoal, msg, jobs_dir=jobs, part=Path(msg.part), program=Path(msg.program) if msg.program else None,
        material=msg.material or DEFAULT_MATERIAL, mode=msg.mode or JobGoal.mode,
        loop_mode=msg.loop_mode or JobGoal.loop_mode, passes=msg.passes or 1,
        learned_dir=Path(msg.learned_dir or jobs / job_folder.LEARNED_DIR),
        **{n: number(getattr(msg, n), getattr(JobGoal, n)) for n in NUMBERS},
    )  # fmt: skip


def goal_from_job(job: dict, resumed: RunJob.Goal) -> JobGoal:
    """The goal of an interrupted job, read from its job.yaml; operator, notes and spool may be new.

    ValueError when the file holds none.
    """
    try:
        stored = with_loop_mode(job['goal'])
        known = {f.name: stored[f.name] for f in fields(JobGoal) if f.name in stored}
    except (KeyError, TypeError):
        raise ValueError('job.yaml holds no goal') from None
    for name in ('part', 'jobs_dir'):
        known[name] = Path(known[name])
    for name in ('learned_dir', 'program'):
        if known.get(name) is not None:
            known[name] = Path(known[name])
    known['program_shift'] = tuple(known.get('program_shift', (0.0, 0.0, 0.0)))
    known['k_gain'] = math.nan if known.get('k_gain') is None else known['k_gain']
    known['notes'] = (*known.get('notes', ()), *resumed.notes)
    known['plan_settings'] = tuple(known.get('plan_settings', ()))
    known['operator_name'] = resumed.operator_name or known.get('operator_name', '')
    if resumed.wire_left:
        known |= {'wire_left': resumed.wire_left, 'new_spool': True}
    return JobGoal(**known)


def anomaly_to_msg(record: AnomalyRecord, job_id: str) -> Anomaly:
    """Position in m, work frame, which is also the frame of the header."""
    fields = {k: v for k, v in vars(record).items() if k != 'time'}
    fields['severity'] = getattr(Anomaly, record.severity)
    return to_msg(Anomaly, stamp=time_to_msg(record.time), frame='work', job_id=job_id, **fields)


def anomaly_from_msg(msg: Anomaly) -> AnomalyRecord:
    """An unknown severity counts as a WARNING."""
    severity = SEVERITIES[msg.severity] if msg.severity < len(SEVERITIES) else 'WARNING'
    return from_msg(AnomalyRecord, msg, time=seconds(msg.header.stamp), severity=severity)


def aim_to_msg(
    point: tuple[float, float, float], zero: tuple[float, float, float], stamp: Time
) -> PointStamped:
    """Where the pyrometer should be aimed. point: m, work frame; zero: of the work frame in machine coordinates, m."""
    place = [a + b for a, b in zip(point, zero, strict=True)]
    return to_msg(PointStamped, stamp=stamp, frame='machine', point=place)


def heat_from_msg(msg: HeatFactor) -> Heat:
    """Temperatures in degC, the wait in s. What no part and no compensator can have is not plausible."""
    reasons = tuple(msg.reasons)
    for name, value, (low, high) in (
        ('temperature', msg.temperature, TEMPERATURES),
        ('heat factor', msg.factor, HEAT_FACTORS),
    ):
        if not low <= value <= high:  # NaN fails every comparison
            reasons += (f'{name} is {value:g}, must be {low:g} .. {high:g}',)
    plausible = msg.plausible and reasons == tuple(msg.reasons)
    return from_msg(
        Heat, msg, known=True, limit=msg.interpass_limit, ready=msg.ready and plausible, wait=msg.estimated_wait,
        plausible=plausible, reasons=reasons,
    )  # fmt: skip


def machine_fields(msg: MachineState) -> dict:
    """The fields of `cell.Machine` that machine_state carries."""
    same = (
        'connected', 'homed', 'fault', 'fault_text', 'silent_nodes', 'message', 'limit_min', 'limit_max', 'work_offset',
        'identity', 'port',
    )  # fmt: skip
    return {n: plain(getattr(msg, n)) for n in same} | {
        'armed_job': msg.armed_job if msg.armed else '',
        'state_at': seconds(msg.header.stamp),
        'firmware': msg.firmware_version,
    }


def scan_from_msg(msg: HeightMap) -> Scan:
    """Raises ValueError when array lengths do not fit the grid."""
    spec = grid_from_msg(msg.grid)
    grid = HeightGrid(spec, map_from_msg(msg.z, spec), map_from_msg(msg.sigma, spec))
    count = np.frombuffer(msg.count, np.uint16).reshape(spec.shape)
    return from_msg(Scan, msg, map=grid, count=count, stamp=seconds(msg.header.stamp), handle=msg)


def begin_request(
    job_id: str, layer: int, spec: GridSpec, laid: cell.LaidBeads
) -> BeginScan.Request:
    """A new map after `layer` layers; laid: beads whose width it is to tell."""
    widths = np.concatenate([np.empty(0), *laid.widths])
    return to_msg(
        BeginScan.Request, job_id=job_id, layer=layer, grid=spec, laid=laid.paths, laid_width=widths
    )


def scan_to_msg(scan: Scan, job_id: str, layer: int, stamp: Time) -> HeightMap:
    """A stored scan as scan_fusion would publish it after `layer` layers."""
    grid = scan.map
    return to_msg(
        HeightMap, stamp=stamp, frame='work', job_id=job_id, layer=layer, grid=grid.spec, z=grid.z,
        sigma=grid.z * np.nan if grid.sigma is None else grid.sigma, count=scan.count, coverage=scan.coverage,
        plausible=scan.plausible, reasons=scan.reasons, bead_width=scan.bead_width, bead_width_u=scan.bead_width_u,
        bead_width_expected=scan.bead_width_expected,
    )  # fmt: skip


def correction_from_msg(msg: CorrectionMap, learned: str = '') -> Correction:
    """learned: of the answer. Raises ValueError when array lengths do not fit the grid."""
    spec = grid_from_msg(msg.grid)
    maps = {
        n: map_from_msg(getattr(msg, n), spec) for n in ('psi', 'confidence', 'residual_height')
    }
    expected = (msg.expected_rms, msg.expected_rms_low, msg.expected_rms_high)
    return from_msg(Correction, msg, learned=learned, expected_rms=expected, handle=msg, **maps)


def correction_request(job_id: str, r: CorrectionRequest, stamp: Time) -> ComputeCorrection.Request:
    """A scan without its message (read from the folder, or joined from two) gets one; `stamp` is its time when its own
    is not known."""
    if math.isfinite(r.scan.stamp):
        stamp = time_to_msg(r.scan.stamp)
    measured = r.scan.handle or scan_to_msg(r.scan, job_id, r.layer - 1, stamp)
    before: dict[str, Any] = {}
    if r.previous_growth is not None and r.previous_surface is not None:
        before = {'previous_growth': r.previous_growth, 'previous_surface': r.previous_surface}
    return to_msg(
        ComputeCorrection.Request, job_id=job_id, layer=r.layer, map=measured, target=r.target,
        planned_height=r.planned, previous_feed_factor=r.previous_feed_factor, bead_width=r.bead_width,
        temperature=r.temperature, k_gain=r.k_gain, heat_factor=r.heat_factor, learned=r.learned,
        ratio_high=r.ratio_high, next_thickness=r.next_thickness, direction=(*r.direction, 0.0), paths=r.beads,
        **before,
    )  # fmt: skip


def next_layer_to_msg(job_id: str, coming: cell.NextLayer, stamp: Time) -> NextLayer:
    """What the correction server can prepare by."""
    return to_msg(
        NextLayer, stamp=stamp, frame='work', job_id=job_id, layer=coming.layer, bead_width=coming.bead_width,
        grid=coming.spec, planned_height=coming.planned, direction=(*coming.direction, 0.0), paths=coming.beads,
    )  # fmt: skip


def feed_request(job_id: str, r: FeedRequest) -> ComputeFeed.Request:
    """The correction goes as the message that it came in."""
    segments = [segment_to_msg(s) for s in r.segments]
    request = to_msg(
        ComputeFeed.Request, job_id=job_id, material=r.material, apply_correction=r.apply, segments=segments,
        heat_factor=r.heat_factor,
    )  # fmt: skip
    if r.correction is not None:
        request.correction = r.correction.handle
    return request
