"""feed_forward: planned segments and a correction in, segments with setpoints out."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from waam_msgs.srv import ComputeFeed
from waam_node import node
from waam_node.params import param
from waam_process import materials
from waam_process.segment import Clamp
from waam_process.units import m_min

from . import conversions as convert
from .feed.feed_forward import Limits, SetpointError, compute
from .feed.lead import Drives

Response = ComputeFeed.Response
CLAMPS = {
    'speed': Clamp.SPEED_LOW | Clamp.SPEED_HIGH,
    'feed': Clamp.FEED_LOW | Clamp.FEED_HIGH,
    'voltage': Clamp.VOLTAGE,
    'psi': Clamp.PSI,
}


@dataclass(frozen=True)
class FeedParams:
    materials_file: str = param(
        '', "operator's table that adds to or replaces the packaged materials"
    )
    speed_min: float = param(3e-3, 'slowest travel of the machine while depositing', 'm/s', 1e-4)
    speed_max: float = param(20e-3, 'fastest travel of the machine while depositing', 'm/s', 1e-3)
    feed_min: float = param(m_min(2.0), 'slowest wire feed of the source', 'm/s', 0.0)
    feed_max: float = param(m_min(12.0), 'fastest wire feed of the source', 'm/s', 1e-3)
    wire_lag: float = param(
        0.0,
        'time constant of the wire drive that the feed leads; 0 = the controller does',
        's',
        0.0,
        1.0,
    )
    acceleration: float = param(
        0.0, 'of travel: less wire where corners take time; 0 = not compensated', 'm/s2', 0.0
    )

    @property
    def drives(self) -> Drives:
        return Drives(self.wire_lag, self.acceleration or math.inf)


class FeedForward(node.WaamNode):
    """Serves ~/compute."""

    def __init__(self) -> None:
        super().__init__('feed_forward', FeedParams)
        self.table = materials.load(self.params.materials_file or None)
        self.create_service(ComputeFeed, '~/compute', self.on_compute)
        self.counts = {'computed': 0, 'refused': 0, 'segments': 0}

    def on_compute(self, request: ComputeFeed.Request, response: Response) -> Response:
        begin = time.perf_counter()
        try:
            self.compute(request)
        except materials.MaterialError as e:
            return self.refuse(response, Response.UNKNOWN_MATERIAL, e)
        except SetpointError as e:
            segment = str(e).startswith('segment')
            return self.refuse(response, Response.BAD_SEGMENT if segment else Response.BAD_INPUT, e)
        except ValueError as e:
            return self.refuse(response, Response.BAD_INPUT, e)
        response.segments = request.segments
        self.counts['computed'] += 1
        self.counts['segments'] += len(request.segments)
        self.values |= {**self.counts, 'latency_ms': round((time.perf_counter() - begin) * 1e3, 1)}
        return response

    def refuse(self, response: Response, code: int, error: Exception) -> Response:
        self.counts['refused'] += 1
        self.values |= self.counts
        response.error_code, response.message = code, str(error)
        self.get_logger().error(f'refused: {error}')
        return response

    def compute(self, request: ComputeFeed.Request) -> None:
        """Writes the setpoints into request.segments. Errors leave them untouched."""
        p = self.params
        material = materials.get(request.material, p.materials_file or None)
        limits = Limits.of(material, (p.speed_min, p.speed_max), (p.feed_min, p.feed_max))
        field = convert.field_from_msg(request.correction)
        path, voltage = convert.path_from_msgs(request.segments)
        volts = np.where(voltage > 0, voltage, material.voltage)
        result = compute(
            path, material, limits, volts, field, request.apply_correction, request.heat_factor,
            p.drives,
        )  # fmt: skip
        convert.write_setpoints(request.segments, path, result)
        for name, bits in CLAMPS.items():
            self.values[f'last_clamps_{name}'] = result.count(bits)


def main() -> None:
    node.main(FeedForward)
