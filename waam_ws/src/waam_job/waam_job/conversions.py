"""Records, snapshots and requests <-> messages."""

from __future__ import annotations

import math
from array import array
from dataclasses import fields
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PointStamped, Vector3

from waam_msgs.action import RunJob
from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    HeatFactor,
    HeightMap,
    JobStatus,
    LayerReport,
    MachineState,
    NextLayer,
)
from waam_msgs.srv import (
    BeginScan,
    ComputeCorrection,
    ComputeFeed,
)
from waam_node import job_folder
from waam_node.conversions import (
    floats,
    grid_from_msg,
    grid_to_msg,
    map_from_msg,
    paths_to_msg,
    seconds,
    segment_to_msg,
    time_to_msg,
)
from waam_process.grid import GridSpec, HeightGrid
from waam_process.loop_mode import with_loop_mode
from waam_process.names import CONTROLLER_STATES, SEVERITIES
from waam_process.operating import DEFAULT_MATERIAL

from .model import cell
from .model.cell import Correction, CorrectionRequest, FeedRequest, Heat, Scan
from .model.goal import JobGoal
from .model.records import AnomalyRecord, LayerRecord, Status

STATES = CONTROLLER_STATES
TEMPERATURES = (-50.0, 2000.0)  # degC, of a part that is laid on
HEAT_FACTORS = (0.1, 1.0)  # of eq 2.19


def goal_from_msg(msg: RunJob.Goal, default_jobs_dir: str) -> JobGoal:
    """Empty fields take their defaults."""

    def number(value: float, default: float) -> float:
        return default if math.isnan(value) or value == 0.0 else value

    jobs = Path(msg.jobs_dir or default_jobs_dir)
    return JobGoal(
        part=Path(msg.part),
        material=msg.material or DEFAULT_MATERIAL,
        jobs_dir=jobs,
        name=msg.name,
        mode=msg.mode or JobGoal.mode,
        loop_mode=msg.loop_mode or JobGoal.loop_mode,
        layers=msg.layers,
        layer_height=number(msg.layer_height, 0.0),
        bead_width=number(msg.bead_width, 0.0),
        k_gain=msg.k_gain,
        tolerance=number(msg.tolerance, JobGoal.tolerance),
        scale=number(msg.scale, JobGoal.scale),
        operator_name=msg.operator_name,
        notes=tuple(msg.notes),
        strategy=msg.strategy,
        allowance=msg.allowance,
        passes=msg.passes or 1,
        wire_left=msg.wire_left,
        plan_settings=tuple(msg.plan_settings),
        repair=msg.repair,
        learned_dir=Path(msg.learned_dir or jobs / job_folder.LEARNED_DIR),
        fresh=msg.fresh,
        program=Path(msg.program) if msg.program else None,
        dialect=msg.dialect,
        program_shift=(msg.program_shift.x, msg.program_shift.y, msg.program_shift.z),
    )


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


def status_to_msg(status: Status, stamp: Time) -> JobStatus:
    """Field by field; the state as its number."""
    msg = JobStatus()
    msg.header.stamp = stamp
    for f in fields(status):
        value = getattr(status, f.name)
        setattr(msg, f.name, int(value) if f.name == 'state' else value)
    return msg


def layer_to_msg(record: LayerRecord, stamp: Time) -> LayerReport:
    """Field by field; SI."""
    msg = LayerReport()
    msg.header.stamp = stamp
    for f in fields(record):
        setattr(msg, f.name, getattr(record, f.name))
    return msg


def anomaly_to_msg(record: AnomalyRecord, job_id: str) -> Anomaly:
    """Position in m, work frame, which is also the frame of the header."""
    x, y, z = record.position
    msg = Anomaly(
        job_id=job_id,
        severity=getattr(Anomaly, record.severity),
        class_name=record.class_name,
        text=record.text,
        reaction=record.reaction,
        layer=record.layer,
        bead=record.bead,
        position=Point(x=float(x), y=float(y), z=float(z)),
    )
    msg.header.stamp = time_to_msg(record.time)
    msg.header.frame_id = 'work'
    return msg


def anomaly_from_msg(msg: Anomaly) -> AnomalyRecord:
    """An unknown severity counts as a WARNING."""
    p = msg.position
    return AnomalyRecord(
        time=seconds(msg.header.stamp),
        severity=SEVERITIES[msg.severity] if msg.severity < len(SEVERITIES) else 'WARNING',
        class_name=msg.class_name,
        text=msg.text,
        reaction=msg.reaction,
        layer=msg.layer,
        bead=msg.bead,
        position=(p.x, p.y, p.z),
    )


def aim_to_msg(
    point: tuple[float, float, float], zero: tuple[float, float, float], stamp: Time
) -> PointStamped:
    """Where the pyrometer should be aimed. point: m, work frame; zero: of the work frame in machine coordinates, m."""
    x, y, z = (float(a + b) for a, b in zip(point, zero, strict=True))
    msg = PointStamped(point=Point(x=x, y=y, z=z))
    msg.header.stamp, msg.header.frame_id = stamp, 'machine'
    return msg


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
    return Heat(
        known=True,
        factor=msg.factor,
        temperature=msg.temperature,
        limit=msg.interpass_limit,
        ready=msg.ready and plausible,
        wait=msg.estimated_wait,
        plausible=plausible,
        reasons=reasons,
        believed=msg.believed,
        doubt=msg.doubt,
    )


def machine_fields(msg: MachineState) -> dict:
    """The fields of `cell.Machine` that machine_state carries."""
    return {
        'connected': msg.connected,
        'homed': msg.homed,
        'armed_job': msg.armed_job if msg.armed else '',
        'fault': msg.fault,
        'fault_text': msg.fault_text,
        'silent_nodes': tuple(msg.silent_nodes),
        'message': msg.message,
        'limit_min': (msg.limit_min.x, msg.limit_min.y, msg.limit_min.z),
        'limit_max': (msg.limit_max.x, msg.limit_max.y, msg.limit_max.z),
        'work_offset': (msg.work_offset.x, msg.work_offset.y, msg.work_offset.z),
        'state_at': seconds(msg.header.stamp),
        'identity': msg.identity,
        'firmware': msg.firmware_version,
        'port': msg.port,
    }


def scan_from_msg(msg: HeightMap) -> Scan:
    """Raises ValueError when array lengths do not fit the grid."""
    spec = grid_from_msg(msg.grid)
    grid = HeightGrid(spec, map_from_msg(msg.z, spec), map_from_msg(msg.sigma, spec))
    return Scan(
        map=grid,
        count=np.frombuffer(msg.count, np.uint16).reshape(spec.shape),
        coverage=msg.coverage,
        plausible=msg.plausible,
        reasons=tuple(msg.reasons),
        profiles_used=msg.profiles_used,
        profiles_rejected=msg.profiles_rejected,
        points_used=msg.points_used,
        points_rejected=msg.points_rejected,
        stamp=seconds(msg.header.stamp),
        bead_width=msg.bead_width,
        bead_width_u=msg.bead_width_u,
        bead_width_expected=msg.bead_width_expected,
        job_id=msg.job_id,
        layer=msg.layer,
        handle=msg,
    )


def begin_request(
    job_id: str, layer: int, spec: GridSpec, laid: cell.LaidBeads
) -> BeginScan.Request:
    """A new map after `layer` layers; laid: beads whose width it is to tell."""
    request = BeginScan.Request(job_id=job_id, layer=layer, grid=grid_to_msg(spec))
    request.laid = paths_to_msg(laid.paths)
    request.laid_width = floats(np.concatenate([np.empty(0), *laid.widths]))
    return request


def scan_to_msg(scan: Scan, job_id: str, layer: int, stamp: Time) -> HeightMap:
    """A stored scan as scan_fusion would publish it after `layer` layers."""
    msg = HeightMap(job_id=job_id, layer=layer, grid=grid_to_msg(scan.map.spec))
    msg.header.stamp, msg.header.frame_id = stamp, 'work'
    msg.z = floats(scan.map.z)
    msg.sigma = floats(scan.map.z * np.nan if scan.map.sigma is None else scan.map.sigma)
    msg.count = array('H', np.ascontiguousarray(scan.count, np.uint16).tobytes())
    msg.coverage, msg.plausible, msg.reasons = scan.coverage, scan.plausible, list(scan.reasons)
    msg.bead_width, msg.bead_width_u = scan.bead_width, scan.bead_width_u
    msg.bead_width_expected = scan.bead_width_expected
    return msg


def correction_from_msg(msg: CorrectionMap, learned: str = '') -> Correction:
    """learned: of the answer. Raises ValueError when array lengths do not fit the grid."""
    spec = grid_from_msg(msg.grid)
    return Correction(
        psi=map_from_msg(msg.psi, spec),
        confidence=map_from_msg(msg.confidence, spec),
        residual_height=map_from_msg(msg.residual_height, spec),
        k_gain=msg.k_gain,
        flow_factor=msg.flow_factor,
        law=msg.law,
        fallback=msg.fallback,
        reasons=tuple(msg.reasons),
        saturated_cells=msg.saturated_cells,
        model_hash=msg.model_hash,
        learned=learned,
        width_ratio=msg.width_ratio,
        expected_rms=(msg.expected_rms, msg.expected_rms_low, msg.expected_rms_high),
        handle=msg,
    )


def correction_request(job_id: str, r: CorrectionRequest, stamp: Time) -> ComputeCorrection.Request:
    """A scan without its message (read from the folder, or joined from two) gets one; `stamp` is its time when its own
    is not known."""
    if math.isfinite(r.scan.stamp):
        stamp = time_to_msg(r.scan.stamp)
    measured = r.scan.handle or scan_to_msg(r.scan, job_id, r.layer - 1, stamp)
    request = ComputeCorrection.Request(job_id=job_id, layer=r.layer, map=measured)
    request.target, request.planned_height = floats(r.target), floats(r.planned)
    if r.previous_growth is not None and r.previous_surface is not None:
        request.previous_growth = floats(r.previous_growth)
        request.previous_surface = floats(r.previous_surface)
    request.previous_feed_factor = float(r.previous_feed_factor)
    request.bead_width, request.temperature = float(r.bead_width), float(r.temperature)
    request.k_gain, request.heat_factor = float(r.k_gain), float(r.heat_factor)
    request.learned, request.ratio_high = r.learned, float(r.ratio_high)
    request.next_thickness = float(r.next_thickness)
    request.direction, request.paths = direction_to_msg(r.direction), paths_to_msg(r.beads)
    return request


def next_layer_to_msg(job_id: str, coming: cell.NextLayer, stamp: Time) -> NextLayer:
    """What the correction server can prepare by."""
    message = NextLayer(job_id=job_id, layer=coming.layer, bead_width=float(coming.bead_width))
    message.header.stamp, message.header.frame_id = stamp, 'work'
    message.grid, message.planned_height = grid_to_msg(coming.spec), floats(coming.planned)
    message.direction, message.paths = (
        direction_to_msg(coming.direction),
        paths_to_msg(coming.beads),
    )
    return message


def direction_to_msg(direction: tuple[float, float]) -> Vector3:
    """In the plane of the layer."""
    return Vector3(x=float(direction[0]), y=float(direction[1]), z=0.0)


def feed_request(job_id: str, r: FeedRequest) -> ComputeFeed.Request:
    """The correction goes as the message that it came in."""
    request = ComputeFeed.Request(job_id=job_id, material=r.material, apply_correction=r.apply)
    request.segments = [segment_to_msg(s) for s in r.segments]
    request.heat_factor = float(r.heat_factor)
    if r.correction is not None:
        request.correction = r.correction.handle
    return request
