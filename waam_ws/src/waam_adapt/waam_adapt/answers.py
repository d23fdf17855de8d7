"""What this package answers and tells: messages in, messages out, without a node.

The nodes answer through these functions, and so does the laboratory (waam_lab), which has no nodes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from waam_msgs.msg import CorrectionMap, JobStatus, LayerReport, NextLayer, ProcessEstimate
from waam_msgs.srv import ComputeCorrection, ComputeFeed
from waam_node.conversions import grid_from_msg
from waam_process import materials

from . import conversions as convert
from .feed.feed_forward import Limits, Setpoints
from .feed.feed_forward import compute as compute_setpoints
from .feed.params import FeedParams
from .thermal.compensator import Compensator
from .types import error_figures

if TYPE_CHECKING:  # the nodes that identify nothing start without SciPy
    from .laws.corrector import Corrector


def correct(
    corrector: Corrector, request: ComputeCorrection.Request, now: float
) -> tuple[CorrectionMap, ProcessEstimate, str]:
    """Psi of the next layer, what is believed of the process (without a header), and what was learned by now
    (`waam_process.learned`, '' when the request told nothing of former jobs). now: ROS time in s. ValueError names the
    field that cannot be used.
    """
    p = corrector.params
    spec = grid_from_msg(request.map.grid)
    core = convert.correction_input(request, spec, p.k_gain, p.k_gain_max)
    last = convert.last_layer(request, spec)
    origin = convert.map_origin(request, now)
    learned = convert.learned_of(request)
    seen = convert.seen_width(request)
    answer = corrector.answer(request.layer, core, origin, last, learned, seen)
    msg = convert.correction_to_msg(
        answer.correction, request, spec, answer.flow_factor, answer.width_ratio, answer.outcome
    )
    msg.error_rms, msg.error_max = error_figures(core)
    estimate = convert.estimate_to_msg(answer.estimate, answer.width, request.job_id, request.layer)
    return msg, estimate, answer.learned.text() if answer.learned else ''


def prepare(corrector: Corrector, msg: NextLayer) -> None:
    """Computes what the plan of a layer alone decides. ValueError names the field that cannot be used."""
    corrector.prepare(convert.next_layer_input(msg, corrector.params.k_gain))


def set_feed(p: FeedParams, request: ComputeFeed.Request) -> Setpoints:
    """Writes the setpoints into request.segments. A ValueError (MaterialError, SetpointError) leaves them untouched."""
    material = materials.get(request.material, p.materials_file or None)
    limits = Limits.of(material, (p.speed_min, p.speed_max), (p.feed_min, p.feed_max))
    field = convert.field_from_msg(request.correction)
    path, voltage = convert.path_from_msgs(request.segments)
    volts = np.where(voltage > 0, voltage, material.voltage)
    result = compute_setpoints(
        path,
        material,
        limits,
        voltage=volts,
        correction=field,
        apply=request.apply_correction,
        heat_factor=request.heat_factor,
    )
    convert.write_setpoints(request.segments, path, result)
    return result


def follow_job(compensator: Compensator, msg: JobStatus) -> bool:
    """Tells the compensator how the job goes on. True when the job lays another material than the one before."""
    if msg.state in (JobStatus.VALIDATING, JobStatus.PREPARING):
        compensator.job_begins()
    changed = compensator.use(msg.material)
    if msg.state == JobStatus.DEPOSITING:
        compensator.layer_begins(msg.job_id, msg.pass_number, msg.layer)
    return changed


def follow_layer(compensator: Compensator, msg: LayerReport) -> None:
    """Tells the compensator what the arc has brought."""
    laid = convert.laid_layer(msg, compensator.monitor.material.arc_efficiency)
    if laid:
        compensator.layer_ends(laid)
