"""correction_server: the scanned surface in, psi of the next layer out."""

from __future__ import annotations

import time
from dataclasses import dataclass

from waam_msgs.msg import CorrectionMap, ProcessEstimate
from waam_msgs.srv import ComputeCorrection
from waam_node import node, qos
from waam_node.conversions import grid_from_msg
from waam_node.params import param

from . import conversions as convert
from .checks import MapLimits, error_figures, reasons_against
from .identification import Identifier, Layer
from .laws import make_law, safe_correct

Response = ComputeCorrection.Response


@dataclass(frozen=True)
class CorrectionParams:
    law: str = param(
        'damped_inverse', 'correction law', choices=('damped_inverse', 'proportional', 'zero')
    )
    k_gain: float = param(
        0.3, 'authority over travel speed when a request names none', '', 0.0, 0.3
    )
    k_gain_max: float = param(0.3, 'largest k_gain that a request may ask for', '', 0.0, 0.9)
    gain: float = param(
        0.9, 'share of the height error that one layer is asked to remove', '', 0.0, 1.2
    )
    regularisation: float = param(
        0.1, 'of the deconvolution of overlapping beads; larger = smoother', '', 1e-3, 10.0
    )
    max_age: float = param(300.0, 'oldest map that is used, ROS time', 's', 1.0)
    min_coverage: float = param(0.9, 'share of the footprint that must be seen', '', 0.0, 1.0)
    max_sigma: float = param(0.3e-3, 'largest median uncertainty of a map', 'm', 0.0)
    max_error: float = param(5e-3, 'largest believable median height error', 'm', 0.0)
    identify: bool = param(
        True, 'learn the efficiency ratio and give it as flow_factor, and the shortfall'
    )
    forgetting: float = param(0.5, 'weight of older layers in the efficiency ratio', '', 0.1, 0.99)
    learning: float = param(
        0.3,
        'weight of the newest layer in the shortfall that comes back in every layer; 0 = off',
        '',
        0.0,
        1.0,
    )


class CorrectionServer(node.WaamNode):
    """Serves ~/compute; publishes what it answers on correction_map and process_estimate
    (latched).
    """

    def __init__(self) -> None:
        super().__init__('correction_server', CorrectionParams)
        p = self.params
        self.law = make_law(p.law, p.gain, p.regularisation)
        self.limits = MapLimits(p.max_age, p.min_coverage, p.max_sigma, p.max_error)
        self.identifier = Identifier(p.forgetting, p.learning)
        self.map_publisher = self.create_publisher(CorrectionMap, 'correction_map', qos.LATCHED)
        self.estimate_publisher = self.create_publisher(
            ProcessEstimate, 'process_estimate', qos.LATCHED
        )
        self.create_service(ComputeCorrection, '~/compute', self.on_compute)
        self.counts = {'computed': 0, 'fallbacks': 0, 'refused': 0}

    def on_compute(self, request: ComputeCorrection.Request, response: Response) -> Response:
        begin = time.perf_counter()
        try:
            response.correction = self.compute(request)
        except ValueError as e:
            self.counts['refused'] += 1
            response.error_code, response.message = Response.BAD_INPUT, str(e)
            self.get_logger().error(f'refused: {e}')
            return response
        response.correction.latency = time.perf_counter() - begin
        self.map_publisher.publish(response.correction)
        self.show(response.correction)
        return response

    def compute(self, request: ComputeCorrection.Request) -> CorrectionMap:
        spec = grid_from_msg(request.map.grid)
        core = convert.correction_input(request, spec, self.params.k_gain, self.params.k_gain_max)
        before = convert.named_map(
            'previous_surface', request.previous_surface, spec, optional=True
        )
        growth = convert.named_map('previous_growth', request.previous_growth, spec, optional=True)
        feed_factor = convert.feed_factor(request)
        reasons = reasons_against(convert.map_origin(request, self.now_s()), core, self.limits)
        last = None
        if not reasons and before is not None and growth is not None:
            last = Layer(before, core.z, growth * feed_factor, core.resolution, core.bead_width)
        self.learn(request, last)
        flow, expected = 1.0, core
        if self.params.identify:
            flow = self.identifier.estimate.flow_factor
            expected = core.expecting(self.identifier.shortfall.share)
        result = safe_correct(self.law, expected, reasons)
        msg = convert.correction_to_msg(result, request, spec, flow)
        msg.error_rms, msg.error_max = error_figures(core)
        return msg

    def learn(self, request: ComputeCorrection.Request, last: Layer | None) -> None:
        """Learns from the last layer, if there is one to trust, and publishes the estimate."""
        self.identifier.start(request.job_id, request.layer)
        if last is not None:
            self.identifier.add(last)
        estimate = self.identifier.estimate
        msg = convert.estimate_to_msg(estimate, request.job_id, request.layer)
        msg.header = request.map.header
        self.estimate_publisher.publish(msg)
        if estimate.drift_alarm:
            self.get_logger().warning(
                f'layer {request.layer}: drift: growth is {estimate.innovation * 1e3:.2f} mm off '
                f'the prediction (efficiency ratio {estimate.efficiency_ratio:.3f})'
            )

    def show(self, msg: CorrectionMap) -> None:
        self.counts['computed'] += 1
        self.counts['fallbacks'] += msg.fallback
        self.level = node.WARN if msg.fallback else node.OK
        self.message = '; '.join(msg.reasons) or 'ok'
        self.values = {
            **self.counts, 'layer': msg.layer, 'latency_ms': round(msg.latency * 1e3, 1),
            'flow_factor': round(msg.flow_factor, 3), 'error_rms_mm': round(msg.error_rms * 1e3, 3),
        }  # fmt: skip
        if msg.fallback:
            self.get_logger().warning(f'layer {msg.layer}: no correction: {self.message}')


def main() -> None:
    node.main(CorrectionServer)
