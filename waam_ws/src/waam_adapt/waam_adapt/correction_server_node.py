"""correction_server: the scanned surface in, psi of the next layer out."""

from __future__ import annotations

import time
from typing import TypeAlias

from waam_msgs.msg import CorrectionMap, NextLayer, ProcessEstimate
from waam_msgs.srv import ComputeCorrection
from waam_node import node, qos

from . import answers
from .laws.corrector import CorrectionParams, Corrector, warm_up

Response: TypeAlias = ComputeCorrection.Response


class CorrectionServer(node.WaamNode):
    """Serves ~/compute; publishes what it answers on correction_map and process_estimate
    (latched).
    """

    def __init__(self) -> None:
        super().__init__('correction_server', CorrectionParams)
        warm_up(self.params)
        self.corrector = Corrector(self.params)
        self.map_publisher = self.create_publisher(CorrectionMap, 'correction_map', qos.LATCHED)
        self.estimate_publisher = self.create_publisher(
            ProcessEstimate, 'process_estimate', qos.LATCHED
        )
        self.create_subscription(NextLayer, 'next_layer', self.on_next_layer, qos.LATCHED)
        self.create_service(ComputeCorrection, '~/compute', self.on_compute)
        self.counts = {'computed': 0, 'prepared': 0, 'fallbacks': 0, 'refused': 0}

    def on_compute(self, request: ComputeCorrection.Request, response: Response) -> Response:
        """The service: BAD_INPUT with a text that names the field when the request cannot be used."""
        begin = time.perf_counter()
        try:
            response.correction, response.learned = self.compute(request)
        except ValueError as e:
            self.counts['refused'] += 1
            response.error_code, response.message = Response.BAD_INPUT, str(e)
            self.get_logger().error(f'refused: {e}')
            return response
        response.correction.latency = time.perf_counter() - begin
        self.map_publisher.publish(response.correction)
        self.show(response.correction)
        return response

    def on_next_layer(self, msg: NextLayer) -> None:
        """Prepares the layer that will be asked for next; one that cannot be used will be refused when it is."""
        try:
            answers.prepare(self.corrector, msg)
        except ValueError as e:
            self.get_logger().warning(f'layer {msg.layer} cannot be prepared: {e}')
        else:
            self.counts['prepared'] += 1
            self.values = {**self.values, **self.counts}

    def compute(self, request: ComputeCorrection.Request) -> tuple[CorrectionMap, str]:
        """The correction of a request and what was learned; ValueError names the field that is wrong."""
        msg, estimate, learned = answers.correct(self.corrector, request, self.now_s())
        estimate.header = request.map.header
        self.publish_estimate(estimate)
        return msg, learned

    def publish_estimate(self, estimate: ProcessEstimate) -> None:
        """What is believed of the process by now, with a line in the log when it has drifted."""
        self.estimate_publisher.publish(estimate)
        if estimate.drift_alarm:
            self.get_logger().warning(
                f'layer {estimate.layer}: drift: growth is {estimate.innovation * 1e3:.2f} mm off '
                f'the prediction (efficiency ratio {estimate.efficiency_ratio:.3f})'
            )

    def show(self, msg: CorrectionMap) -> None:
        """Counts and figures of an answer for the diagnostics."""
        self.counts['computed'] += 1
        self.counts['fallbacks'] += msg.fallback
        self.level = node.WARN if msg.fallback else node.OK
        self.message = '; '.join(msg.reasons) or 'ok'
        self.values = {
            **self.counts, 'layer': msg.layer, 'latency_ms': round(msg.latency * 1e3, 1),
            'flow_factor': round(msg.flow_factor, 3), 'error_rms_mm': round(msg.error_rms * 1e3, 3),
        }  # fmt: skip
        if msg.fallback:
            self.get_logger().warning(f'layer {msg.layer}: fallback to {msg.law}: {self.message}')


def main() -> None:
    node.main(CorrectionServer)
