"""Messages <-> arrays of this package. Big fields go through buffers, never through lists."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING, Any

import numpy as np
from sensor_msgs.msg import Temperature

from waam_msgs.msg import (
    CorrectionMap,
    HeatFactor,
    LayerReport,
    NextLayer,
    ProcessEstimate,
    Segment,
)
from waam_msgs.srv import ComputeCorrection
from waam_node.conversions import (
    grid_from_msg,
    map_from_msg,
    paths_from_msg,
    seconds,
    to_msg,
)
from waam_process.grid import GridSpec
from waam_process.heat import ArcPass
from waam_process.learned import Learned, LearnedError, parse

from .feed.feed_forward import Field, Path, Setpoints
from .identify.bead_width import SeenWidth, WidthEstimate
from .laws.checks import MapOrigin
from .thermal.interpass import Heat
from .thermal.response import LaidLayer
from .types import Correction, CorrectionError, CorrectionInput, LastLayer

if TYPE_CHECKING:
    from .identify.estimate import Estimate
    from .identify.layers import Outcome


def optional_map(name: str, values: array, spec: GridSpec) -> np.ndarray | None:
    """As `named_map`; None where the field is empty."""
    return named_map(name, values, spec) if len(values) else None


def named_map(name: str, values: array, spec: GridSpec) -> np.ndarray:
    """(rows, cols) float64; CorrectionError names the field."""
    try:
        a = map_from_msg(values, spec)
    except ValueError as e:
        raise CorrectionError(f'{name}: {e}') from None
    if np.isinf(a).any():
        raise CorrectionError(f'{name} has infinite values')
    return a


def number(name: str, value: float, low: float, high: float, nan_ok: bool = False) -> float:
    """The value when it lies in low .. high, else CorrectionError with field and limit."""
    if np.isnan(value) and nan_ok:
        return value
    if not low <= value <= high:
        raise CorrectionError(f'{name} is {value}, must be {low:g} .. {high:g}')
    return value


def correction_input(
    request: ComputeCorrection.Request, spec: GridSpec, k_gain: float, k_gain_max: float
) -> CorrectionInput:
    """k_gain: the server's default, used when the request says NaN. CorrectionError names the
    field.
    """
    if request.layer < 1:
        raise CorrectionError('layer is 0, layers count from 1')
    number('temperature', request.temperature, -50, 2000, nan_ok=True)
    # float32 of maps
    asked = number('k_gain', request.k_gain, 0.0, k_gain_max * (1 + 1e-6), nan_ok=True)
    for axis in ('x', 'y'):
        number(f'direction.{axis}', getattr(request.direction, axis), -1e6, 1e6)
    return CorrectionInput(
        z=named_map('map.z', request.map.z, spec),
        sigma=optional_map('map.sigma', request.map.sigma, spec),
        target=named_map('target', request.target, spec),
        planned=named_map('planned_height', request.planned_height, spec),
        resolution=spec.resolution,
        bead_width=number('bead_width', request.bead_width, 5e-4, 0.05),
        k_gain=k_gain if np.isnan(asked) else asked,
        direction=(request.direction.x, request.direction.y),
        paths=bead_paths(request, spec),
        temperature=request.temperature,
        heat_factor=heat_factor(request),
        ratio_high=ratio_high(request),
        next_thickness=next_thickness(request),
    )


def next_layer_input(msg: NextLayer, k_gain: float) -> CorrectionInput:
    """The announced layer on a surface that lies as it should. CorrectionError or GridError names the field."""
    spec = grid_from_msg(msg.grid)
    flat = np.zeros(spec.shape)
    return CorrectionInput(
        z=flat,
        target=flat,
        planned=named_map('planned_height', msg.planned_height, spec),
        resolution=spec.resolution,
        bead_width=number('bead_width', msg.bead_width, 5e-4, 0.05),
        k_gain=k_gain,
        direction=(msg.direction.x, msg.direction.y),
        paths=bead_paths(msg, spec),
    )


def bead_paths(
    request: ComputeCorrection.Request | NextLayer, spec: GridSpec
) -> tuple[np.ndarray, ...]:
    """(n, 2) m from the corner of cell (0, 0), one per stretch with the arc on; CorrectionError names the path."""
    corner = np.array([spec.origin_x, spec.origin_y])
    paths = []
    for i, path in enumerate(_told_paths(request)):
        if len(path) < 2 or not np.isfinite(path).all():
            raise CorrectionError(f'paths[{i}] must have at least two finite points')
        paths.append(path - corner)
    return tuple(paths)


def _told_paths(request: ComputeCorrection.Request | NextLayer) -> list[np.ndarray]:
    """Each (n, 2) m in the work frame. Records of 0.2 and before tell `beads`, a polygon for each path."""
    if hasattr(request, 'beads'):
        return [np.array([(p.x, p.y) for p in b.points]).reshape(-1, 2) for b in request.beads]
    try:
        return paths_from_msg(request.paths)
    except ValueError as e:
        raise CorrectionError(f'paths: {e}') from None


def heat_factor(request: ComputeCorrection.Request) -> float:
    """Factor of the wire feed by eq 2.19 that the layer will be laid with; 0 or NaN = 1."""
    factor = number('heat_factor', request.heat_factor, 0.0, 1.0, nan_ok=True)
    return 1.0 if np.isnan(factor) or factor == 0 else factor


def ratio_high(request: ComputeCorrection.Request) -> float:
    """Largest relative layer height of a setpoint; 0 = the law's own limits. Older records do not tell it."""
    told = number('ratio_high', getattr(request, 'ratio_high', 0.0), 0.0, 10.0, nan_ok=True)
    return 0.0 if np.isnan(told) else told


def next_thickness(request: ComputeCorrection.Request) -> float:
    """Median metal of the layer after this one, m; 0 = none, or not known. Older records do not tell it."""
    name = 'next_thickness'
    told = number(name, getattr(request, name, 0.0), 0.0, 0.05, nan_ok=True)
    return 0.0 if np.isnan(told) else told


def feed_factor(request: ComputeCorrection.Request) -> float:
    """Factor of the wire feed that the last layer was laid with (flow and heat); 0 or NaN = 1."""
    factor = number('previous_feed_factor', request.previous_feed_factor, 0.0, 3.0, nan_ok=True)
    return 1.0 if np.isnan(factor) or factor == 0 else factor


def last_layer(request: ComputeCorrection.Request, spec: GridSpec) -> LastLayer:
    """CorrectionError names the field."""
    return LastLayer(
        optional_map('previous_surface', request.previous_surface, spec),
        optional_map('previous_growth', request.previous_growth, spec),
        feed_factor(request),
    )


def learned_of(request: ComputeCorrection.Request) -> Learned | None:
    """What former jobs have taught, None = nothing was told; older records do not have the field.
    CorrectionError says what is wrong with it."""
    text = getattr(request, 'learned', '')
    try:
        return parse(text) if text else None
    except LearnedError as e:
        raise CorrectionError(f'learned: {e}') from None


def seen_width(request: ComputeCorrection.Request) -> SeenWidth:
    """Bead width in the map, NaN where none is; older records do not have the fields."""
    names = ('bead_width', 'bead_width_u', 'bead_width_expected')
    return SeenWidth(*(float(getattr(request.map, name, np.nan)) for name in names))


def map_origin(request: ComputeCorrection.Request, now: float) -> MapOrigin:
    """now: ROS time in s."""
    m = request.map
    return MapOrigin(
        age=now - seconds(m.header.stamp),
        job_id=m.job_id,
        expected_job_id=request.job_id,
        layers=m.layer,
        expected_layers=request.layer - 1,
        plausible=m.plausible,
        reasons=tuple(m.reasons),
    )


def correction_to_msg(
    result: Correction,
    request: ComputeCorrection.Request,
    spec: GridSpec,
    flow_factor: float,
    width_ratio: float = 0.0,
    outcome: Outcome | None = None,
) -> CorrectionMap:
    """The answer to a request: maps (rows, cols) of `spec`, metres and ratios as in CorrectionMap."""
    told: dict[str, Any] = {}
    if outcome is not None:
        told = {
            'expected_rms': outcome.rms,
            'expected_rms_low': outcome.low,
            'expected_rms_high': outcome.high,
        }
    return to_msg(
        CorrectionMap, result, header=request.map.header, job_id=request.job_id, layer=request.layer, grid=spec,
        flow_factor=flow_factor, saturated_cells=result.saturated_cells, width_ratio=width_ratio, **told,
    )  # fmt: skip


def estimate_to_msg(
    estimate: Estimate, width: WidthEstimate, job_id: str, layer: int
) -> ProcessEstimate:
    """What is believed of the process after `layer`, without a header."""
    ratio, sigma = (width.ratio, width.sigma) if width.layers else (np.nan, np.nan)
    same = (
        'efficiency_ratio',
        'efficiency_sigma',
        'height_exponent',
        'spread',
        'innovation',
        'drift_alarm',
    )
    return to_msg(
        ProcessEstimate, job_id=job_id, layer=layer, height_exponent_sigma=estimate.slope_sigma, width_ratio=ratio,
        width_ratio_sigma=sigma, **{n: getattr(estimate, n) for n in same},
    )  # fmt: skip


def field_from_msg(msg: CorrectionMap) -> Field | None:
    """None when the message carries no psi. GridError, CorrectionError or SetpointError name what
    is wrong.
    """
    if not len(msg.psi):
        return None
    spec = grid_from_msg(msg.grid)
    return Field(
        spec,
        named_map('correction.psi', msg.psi, spec),
        named_map('correction.residual_height', msg.residual_height, spec),
        msg.k_gain,
        msg.flow_factor,
        getattr(msg, 'width_ratio', 0.0),
    )


def path_from_msgs(segments: list[Segment]) -> tuple[Path, np.ndarray]:
    """Arrays of n segments and their planned voltages (n,). Where speed_programmed is not set,
    speed is V_prog.
    """
    rows = [
        (
            s.index, s.kind, a.x, a.y, a.z, b.x, b.y, b.z,
            s.height, s.width, s.speed_programmed, s.speed, s.voltage,
        )
        for s in segments
        for a, b in ((s.start, s.end),)
    ]  # fmt: skip
    t = np.array(rows, float).reshape(-1, 13)
    speed = np.where(t[:, 10] == 0, t[:, 11], t[:, 10])
    kinds = t[:, 1].astype(int)
    path = Path(
        index=t[:, 0].astype(int),
        kind=kinds,
        start=t[:, 2:5],
        end=t[:, 5:8],
        height=t[:, 8],
        width=t[:, 9],
        speed=speed,
    )
    return path, t[:, 12]


def write_setpoints(segments: list[Segment], path: Path, result: Setpoints) -> None:
    """Puts the setpoints and their terms into the segments that deposit; the others stay as they
    are.
    """
    names = ('speed', 'wire_feed_speed', 'voltage', 'wire_feed_base', 'psi', 'residual_height')
    columns = zip(*(getattr(result, n).tolist() for n in names), strict=True)
    common = (result.k_gain, result.heat_factor, result.flow_factor)
    for s, deposit, programmed, values, clamps in zip(
        segments,
        result.deposit.tolist(),
        path.speed.tolist(),
        columns,
        result.clamps.tolist(),
        strict=True,
    ):
        if not deposit:
            continue
        s.speed, s.wire_feed_speed, s.voltage, s.wire_feed_base, s.psi, s.residual_height = values
        s.k_gain, s.heat_factor, s.flow_factor = common
        s.speed_programmed, s.clamps = programmed, clamps


def heat_to_msg(heat: Heat, interpass_limit: float, material: str) -> HeatFactor:
    """Without its header."""
    fields = {k: v for k, v in vars(heat).items() if k not in ('rate', 'wait')}
    return to_msg(
        HeatFactor, temperature_rate=heat.rate, estimated_wait=heat.wait, interpass_limit=interpass_limit,
        material=material, believed=heat.believed, **fields,
    )  # fmt: skip


def laid_layer(report: LayerReport, arc_efficiency: float) -> LaidLayer | None:
    """What the arc brought to the layer of a report; None when it laid none."""
    if report.final or not (report.arc_on_time > 0 and report.travel_speed_mean > 0):
        return None
    power = arc_efficiency * report.energy / report.arc_on_time
    arc = ArcPass(power, report.travel_speed_mean, report.arc_on_time)
    return LaidLayer(report.layer, seconds(report.header.stamp), arc)


def temperature_sample(msg: Temperature) -> tuple[float, float]:
    """Time in s (ROS) and degC."""
    return seconds(msg.header.stamp), msg.temperature
