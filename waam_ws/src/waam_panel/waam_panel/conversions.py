"""Messages -> what the page shows (mm, mm/s, m/min; NaN becomes None); the setup -> the goal of a job."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Temperature

from waam_msgs.action import RunJob
from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    HeatFactor,
    HeightMap,
    JobStatus,
    LayerPlan,
    LinkStatus,
    MachineState,
    ProcessControl,
    Segment,
    Standoff,
    Telemetry,
)
from waam_node.conversions import grid_from_msg, map_from_msg, nanoseconds, seconds
from waam_process.names import controller_state, job_state

from . import pictures
from .programs import ProgramChoice
from .setup_form import JobSetup
from .state import Sample


def number(value: float, factor: float = 1.0, digits: int = 4) -> float | None:
    """Rounded, None for NaN and infinity: JSON has neither."""
    return round(value * factor, digits) if math.isfinite(value) else None


def _mm(point: Any) -> list[float | None]:
    return [number(v, 1e3, 3) for v in (point.x, point.y, point.z)]


WIRE_FEEDS = {Telemetry.WIRE_FEED_NORMAL: 'feed normal', Telemetry.WIRE_FEED_UNDERFEED: 'underfeed'}


def sample(m: Telemetry) -> Sample:
    """One telemetry frame."""
    p = m.position
    return Sample(
        t=nanoseconds(m.header.stamp) * 1e-9,
        position=(p.x, p.y, p.z),
        current=m.arc_current,
        voltage=m.arc_voltage,
        feed_commanded=m.wire_feed_commanded,
        feed=m.wire_feed_speed,
        speed=m.travel_speed,
        state=controller_state(m.state),
        arc=m.arc_established,
        arc_enabled=m.arc_enabled,
        gas=m.gas,
        speed_override=m.speed_override,
        wire_override=m.wire_override,
        lease_left=m.lease_left,
        wire_feed=WIRE_FEEDS.get(m.wire_feed, ''),
    )


def machine(m: MachineState) -> dict[str, Any]:
    """Lengths in mm."""
    return {
        'connected': m.connected, 'port': m.port, 'identity': m.identity, 'firmware': m.firmware_version,
        'boot': m.boot_id, 'capabilities': list(m.capabilities), 'state': controller_state(m.state),
        'homed': m.homed, 'armed': m.armed, 'armed_job': m.armed_job, 'fault': m.fault, 'fault_text': m.fault_text,
        'silent': list(m.silent_nodes), 'message': m.message, 'work_offset': _mm(m.work_offset),
        'limit_min': _mm(m.limit_min), 'limit_max': _mm(m.limit_max),
    }  # fmt: skip


def link(m: LinkStatus) -> dict[str, Any]:
    """Round trip in ms (99 % are shorter), telemetry in frames per second."""
    return {
        'round_trip_ms': number(m.round_trip_p99, 1e3, 2), 'rate': number(m.telemetry_rate, 1, 1),
        'lost': m.telemetry_lost, 'resends': m.resends, 'queued': m.segments_queued,
        'underruns': m.underruns, 'reconnects': m.reconnects,
    }  # fmt: skip


def job(m: JobStatus) -> dict[str, Any]:
    """Errors in mm, time left in s."""
    return {
        'id': m.job_id, 'dir': m.job_dir, 'state': job_state(m.state),
        'loop_mode': m.loop_mode, 'material': m.material, 'k_gain': number(m.k_gain), 'layer': m.layer,
        'layers': m.layers, 'bead': m.bead, 'beads': m.beads, 'pass': m.pass_number, 'passes': m.passes,
        'progress': number(m.progress, 1, 4), 'time_left': number(m.time_left, 1, 0),
        'rms_mm': number(m.height_error_rms, 1e3), 'max_mm': number(m.height_error_max, 1e3),
        'error_code': m.error_code, 'message': m.message,
    }  # fmt: skip


def heat(m: HeatFactor) -> dict[str, Any]:
    """Temperatures in degC, rate in K/s, wait in s."""
    return {
        'factor': number(m.factor), 'temperature': number(m.temperature, 1, 1),
        'rate': number(m.temperature_rate, 1, 2),
        'limit': number(m.interpass_limit, 1, 1), 'ready': m.ready, 'wait': number(m.estimated_wait, 1, 0),
        'plausible': m.plausible, 'reasons': list(m.reasons),
    }  # fmt: skip


STANDOFF_SOURCES = {
    Standoff.SOURCE_LASER: 'laser', Standoff.SOURCE_INFRARED: 'infrared sensor', Standoff.SOURCE_ARC: 'arc',
}  # fmt: skip
STANDOFF_ALARMS = {
    Standoff.ALARM_NONE: '', Standoff.ALARM_NO_READING: 'no reading', Standoff.ALARM_FROZEN: 'reading is frozen',
    Standoff.ALARM_NO_ANSWER: 'does not answer', Standoff.ALARM_AT_LIMIT: 'at its limit',
    Standoff.ALARM_CONTRADICTS_ARC: 'contradicts the arc',
}  # fmt: skip


def standoff(m: Standoff) -> dict[str, Any]:
    """mm; alarm: what is wrong, '' = nothing."""
    return {
        'source': STANDOFF_SOURCES.get(m.source, f'source {m.source}'), 'set_mm': number(m.set_distance, 1e3, 2),
        'measured_mm': number(m.measured_distance, 1e3, 2), 'correction_mm': number(m.correction, 1e3, 2),
        'alarm': STANDOFF_ALARMS.get(m.alarm, f'alarm {m.alarm}'),
    }  # fmt: skip


PROCESS_VALUES = {  # name, unit on the page, factor to it
    ProcessControl.VALUE_CURRENT: ('current', 'A', 1.0), ProcessControl.VALUE_POWER: ('power', 'W', 1.0),
    ProcessControl.VALUE_HEAT_INPUT: ('heat input', 'J/mm', 1e-3),
}  # fmt: skip


def process(m: ProcessControl) -> dict[str, Any]:
    """The value that is held, in its unit; factors of travel speed and wire; frozen: why they stay, '' = they move."""
    name, unit, factor = PROCESS_VALUES.get(m.value, (f'value {m.value}', '', 1.0))
    return {
        'value': name, 'unit': unit, 'set': number(m.reference, factor, 1), 'measured': number(m.measured, factor, 1),
        'speed': number(m.speed_factor), 'wire': number(m.wire_factor),
        'operator_speed': number(m.operator_speed_factor), 'operator_wire': number(m.operator_wire_factor),
        'limited': m.limited, 'frozen': m.reason if m.frozen else '',
    }  # fmt: skip


def width(m: HeightMap) -> dict[str, Any] | None:
    """Bead width in mm as the scan shows it; None where no bead stands free."""
    if not m.bead_width_sections:
        return None
    return {
        'layer': m.layer, 'width_mm': number(m.bead_width, 1e3, 2), 'u_mm': number(m.bead_width_u, 1e3, 2),
        'expected_mm': number(m.bead_width_expected, 1e3, 2), 'sections': m.bead_width_sections,
    }  # fmt: skip


def temperature(m: Temperature) -> dict[str, Any]:
    """degC; None while the sensor gives none."""
    return {'value': number(m.temperature, 1, 1)}


def diagnostics(m: DiagnosticArray) -> list[dict[str, Any]]:
    """One row per node; viewer: where the dashboard serves the rerun viewer; restarted: why the supervisor has started
    the node again."""
    rows = []
    for s in m.status:
        values = {v.key: v.value for v in s.values}
        rows.append({
            'node': s.hardware_id, 'level': s.level[0], 'message': s.message, 'viewer': values.get('viewer', ''),
            'restarted': values.get('restarted', ''),
        })  # fmt: skip
    return rows


def anomaly(m: Anomaly) -> dict[str, Any]:
    """The text with its place and the reaction to it."""
    place = f' (layer {m.layer}, bead {m.bead})' if m.layer else ''
    return {
        'class': m.class_name, 'severity': m.severity,
        'text': f'{m.text}{place}' + (f'. Reaction: {m.reaction}' if m.reaction else ''),
    }  # fmt: skip


def height(m: HeightMap) -> dict[str, Any]:
    """The surface, its number in the job, and the map itself for planning from it."""
    spec = grid_from_msg(m.grid)
    z = map_from_msg(m.z, spec)
    title = f'scan {m.scan_id} after layer {m.layer}' + ('' if m.plausible else ', not believed')
    return {
        'picture': pictures.height_map(spec, z) | {'title': title}, 'job_id': m.job_id,
        'scan_id': m.scan_id, 'layer': m.layer, 'spec': spec, 'z': z, 'time': seconds(m.header.stamp),
        'width': width(m),
    }  # fmt: skip


def correction(m: CorrectionMap) -> dict[str, Any]:
    """Psi as a picture from -1 to 1, and why the correction is what it is. ValueError when the map does not fit its
    grid."""
    spec = grid_from_msg(m.grid)
    title = f'for layer {m.layer}, {m.law}' + (', fallback' if m.fallback else '') + _expected(m)
    psi = pictures.encode_map(spec, map_from_msg(m.psi, spec), -1.0, 1.0, 1e4)
    return {
        'psi': psi | {'title': title}, 'reasons': list(m.reasons), 'fallback': m.fallback,
        'width_ratio': number(m.width_ratio),
    }  # fmt: skip


def _expected(m: CorrectionMap) -> str:
    """What the correction expects of the surface after its layer, in words; '' = it cannot say."""
    rms, low, high = (1e3 * v for v in (m.expected_rms, m.expected_rms_low, m.expected_rms_high))
    return f'; expected after it: RMS {rms:.2f} mm ({low:.2f} to {high:.2f})' if rms > 0 else ''


def plan(m: LayerPlan) -> dict[str, Any]:
    """Path of a layer as strips, and its deposition segments for the commanded speed."""
    s = m.segments
    start, end = (
        np.array([(p.x, p.y, p.z) for p in (getattr(x, n) for x in s)], float).reshape(-1, 3)
        for n in ('start', 'end')
    )
    laid = np.array([x.kind == Segment.DEPOSIT for x in s], bool)
    return {
        'path': pictures.paths(laid, start, end) | {'layer': m.layer, 'deposits': bool(laid.any())},
        'start': start[laid, :2], 'end': end[laid, :2],
        'speed': np.array([x.speed for x in s], float)[laid], 'layer': m.layer,
    }  # fmt: skip


CONVERT: dict[str, Callable[[Any], Any]] = {
    'telemetry': sample, 'machine': machine, 'link': link, 'job': job, 'heat': heat, 'plan': plan,
    'temperature': temperature, 'diagnostics': diagnostics, 'anomaly': anomaly, 'height': height,
    'correction': correction, 'standoff': standoff, 'process': process,
}  # fmt: skip


def goal(setup: JobSetup, part: Path, jobs_dir: Path) -> RunJob.Goal:
    """mm of the page to m of the goal."""
    return RunJob.Goal(
        name=setup.name, part=str(part), mode=setup.mode, material=setup.material, loop_mode=setup.loop_mode,
        layers=setup.layers, layer_height=setup.layer_height_mm * 1e-3, bead_width=setup.bead_width_mm * 1e-3,
        k_gain=setup.k_gain, tolerance=setup.tolerance_mm * 1e-3, scale=1e-3, jobs_dir=str(jobs_dir),
        operator_name=setup.operator_name, passes=setup.passes,
        allowance=setup.allowance_mm * 1e-3, notes=setup.notes, wire_left=setup.wire_left_m,
        plan_settings=[f'finish={setup.finish}'] if setup.mode == 'restore' else [],
    )  # fmt: skip


def program_goal(
    choice: ProgramChoice, program: Path, nominal: Path | None, jobs_dir: Path
) -> RunJob.Goal:
    """The goal of `waam job run PROGRAM --mode build`: mm of the page to m."""
    goal = RunJob.Goal(
        part=str(nominal or ''), program=str(program), dialect=choice.dialect, mode='build',
        material=choice.material, loop_mode=choice.loop_mode, k_gain=math.nan, tolerance=0.2e-3, scale=1e-3,
        jobs_dir=str(jobs_dir), operator_name=choice.operator_name, passes=1, notes=['started_from=panel'],
    )  # fmt: skip
    shift = goal.program_shift
    shift.x, shift.y, shift.z = (v * 1e-3 for v in choice.shift_mm)
    return goal


def resumed(folder: Path) -> RunJob.Goal:
    """The goal that resumes an interrupted job; everything else is in its job.yaml."""
    return RunJob.Goal(resume_dir=str(folder.resolve()), notes=['resumed_from=panel'])
