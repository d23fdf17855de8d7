"""Messages -> what the scene draws."""

from __future__ import annotations

import numpy as np

from waam_msgs.msg import (
    Anomaly,
    CorrectionMap,
    HeightMap,
    JobStatus,
    LayerPlan,
    LayerReport,
    Segment,
    Telemetry,
)
from waam_node.conversions import grid_from_msg, map_from_msg, nanoseconds
from waam_process.names import job_state

from .scene import CorrectionData, MapData, Sample
from .surface import LayerPath

ENDED = (JobStatus.DONE, JobStatus.FAILED, JobStatus.ABORTED)


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
