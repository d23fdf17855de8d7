"""Messages -> what the scene draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Temperature

from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    HeatFactor,
    HeightMap,
    JobStatus,
    LayerPlan,
    LayerReport,
    MachineState,
    Segment,
    Telemetry,
)
from waam_node import cdr
from waam_node.conversions import grid_from_msg, map_from_msg, nanoseconds
from waam_process.names import job_state
from waam_process.unrolled import UNROLLED

from . import blueprint as bp
from .scene import CorrectionData, MapData, Sample, Scene
from .surface import LayerPath

ENDED = (JobStatus.DONE, JobStatus.FAILED, JobStatus.ABORTED)
TYPES = {  # topics that are drawn, but telemetry
    'height_map': HeightMap, 'correction_map': CorrectionMap, 'layer_plan': LayerPlan, 'heat_factor': HeatFactor,
    'temperature': Temperature, 'job_status': JobStatus, 'layer_report': LayerReport, 'machine_state': MachineState,
    'anomaly': Anomaly,
}  # fmt: skip
NEWEST = (
    'height_map',
    'correction_map',
    'layer_plan',
)  # who is late draws only the newest of these

SAMPLE_NS = 100_000_000  # of ROS time: 10 Hz, as telemetry.npz


class MessageDrawing:
    """What the messages of a cell draw, live and out of a record alike."""

    def __init__(self) -> None:
        self._errors = (0.0, 0.0)
        self._machine = ''

    def of(self, topic: str, msg: Any) -> Callable[[Scene], None]:
        """topic: of TYPES. Converting and drawing happen when the result is called."""
        t = nanoseconds(msg.header.stamp)
        match topic:
            case 'height_map':
                return lambda scene: scene.height_map(map_data(msg))
            case 'correction_map':
                return lambda scene: scene.correction(correction_data(msg))
            case 'layer_plan':
                return lambda scene: scene.plan(t, layer_path(msg))
            case 'temperature':
                return lambda scene: scene.scalar(t, bp.TEMPERATURE, msg.temperature)
            case 'layer_report':
                return lambda scene: scene.text(t, 0, report_text(msg))
            case 'anomaly':
                return lambda scene: scene.text(t, msg.severity, anomaly_text(msg))
            case 'heat_factor':
                return lambda scene: _draw_heat(scene, t, msg)
            case 'machine_state':
                said, self._machine = self._machine, msg.message
                if not msg.message or msg.message == said:
                    return lambda scene: None
                severity = 2 if msg.fault else 0
                return lambda scene: scene.text(t, severity, f'machine: {msg.message}')
        errors, before = (msg.height_error_rms * 1e3, msg.height_error_max * 1e3), self._errors
        self._errors = errors
        return lambda scene: _draw_job(scene, t, msg, errors if errors != before else ())


def _draw_heat(scene: Scene, t: int, msg: HeatFactor) -> None:
    scene.scalar(t, bp.HEAT_FACTOR, 100 * msg.factor)
    scene.scalar(t, bp.LIMIT, msg.interpass_limit)


def _draw_job(scene: Scene, t: int, msg: JobStatus, errors: tuple[float, ...]) -> None:
    """errors: mm, when they have changed."""
    scene.layer(t, msg.layer)
    scene.state(t, bp.JOB, job_state(msg.state))
    scene.status(t, status_text(msg) + (f'\n\nA shaft, {UNROLLED}.' if scene.shaft else ''))
    if errors:
        scene.scalar(t, bp.RMS, *errors)


class Samples:
    """Of the telemetry one frame per SAMPLE_NS is decoded and drawn."""

    def __init__(self) -> None:
        self._next_ns = 0

    def of(self, raw: bytes) -> Sample | None:
        """The frame (CDR), None when the one before is too near. Time may begin anew."""
        t = cdr.stamp_ns(raw)
        if self._next_ns - 2 * SAMPLE_NS <= t < self._next_ns:
            return None
        self._next_ns = t + SAMPLE_NS
        return sample(deserialize_message(raw, Telemetry))


def sample(msg: Telemetry) -> Sample:
    """An override of 0, as old records have it, counts as 1."""
    p = msg.position
    return Sample(
        t=nanoseconds(msg.header.stamp),
        position=(p.x, p.y, p.z),
        speed=msg.travel_speed,
        feed_commanded=msg.wire_feed_commanded,
        feed=msg.wire_feed_speed,
        current=msg.arc_current,
        voltage=msg.arc_voltage,
        state=msg.state,
        arc=msg.arc_established,
        speed_override=msg.speed_override or 1.0,
    )


def map_data(msg: HeightMap) -> MapData:
    """Raises ValueError when the map does not fit its grid."""
    spec = grid_from_msg(msg.grid)
    return MapData(nanoseconds(msg.header.stamp), spec, map_from_msg(msg.z, spec))


def correction_data(msg: CorrectionMap) -> CorrectionData:
    """Without a confidence map it is 1 everywhere. ValueError when a map does not fit its grid."""
    spec = grid_from_msg(msg.grid)
    psi = map_from_msg(msg.psi, spec)
    confidence = map_from_msg(msg.confidence, spec) if len(msg.confidence) else np.ones(psi.shape)
    return CorrectionData(nanoseconds(msg.header.stamp), msg.layer, psi, confidence)


def layer_path(msg: LayerPlan) -> LayerPath:
    """The n segments that lay metal: ends (n, 3) m; height, width m and speed m/s (n,)."""
    laid = [s for s in msg.segments if s.kind == Segment.DEPOSIT]

    def points(name: str) -> np.ndarray:
        found = [(p.x, p.y, p.z) for p in (getattr(s, name) for s in laid)]
        return np.array(found, float).reshape(-1, 3)

    height, width, speed = (
        np.array([getattr(s, n) for s in laid], float) for n in ('height', 'width', 'speed')
    )
    return LayerPath(msg.layer, points('start'), points('end'), height, width, speed)


def status_text(msg: JobStatus) -> str:
    """The job in a few lines of markdown."""
    left = '–' if not np.isfinite(msg.time_left) else f'{msg.time_left / 60:.1f} min'
    rms, largest = (
        '–' if not np.isfinite(v) else f'{v * 1e3:.3f} mm'
        for v in (msg.height_error_rms, msg.height_error_max)
    )
    rows = [
        ('state', f'**{job_state(msg.state)}**'),
        ('loop mode', msg.loop_mode.replace('_', ' ')),
        ('layer', f'{msg.layer} of {msg.layers}'),
        ('bead', f'{msg.bead} of {msg.beads}'),
        ('progress', f'{100 * msg.progress:.0f} %'),
        ('time left', left),
        ('RMS height error', rms),
        ('largest error', largest),
    ]
    table = '\n'.join(f'| {k} | {v} |' for k, v in rows)
    said = f'\n\n{msg.message}' if msg.message else ''
    return f'**{msg.job_id or "no job"}**\n\n| | |\n|---|---|\n{table}{said}'


def anomaly_text(msg: Anomaly) -> str:
    """One line with class, place and reaction."""
    place = f' (layer {msg.layer}, bead {msg.bead})' if msg.layer else ''
    return f'{msg.class_name}: {msg.text}{place}; reaction: {msg.reaction or "none"}'


def report_text(msg: LayerReport) -> str:
    """One line: error (mm) of the surface before the layer, mean current and voltage, heat input (J/mm), clamps."""
    rms = f'RMS {msg.height_error_rms * 1e3:.3f} mm'
    if msg.final:
        return f'final surface: {rms}'
    clamps = (msg.clamps_speed, msg.clamps_feed, msg.clamps_voltage, msg.clamps_psi)
    return (
        f'layer {msg.layer} laid: {rms} before, {msg.current_mean:.0f} A, {msg.voltage_mean:.1f} V, '
        f'{msg.heat_input * 1e-3:.0f} J/mm, clamps {"/".join(map(str, clamps))}'
    )
