"""feed_forward: planned segments and a correction in, segments with setpoints out."""

from __future__ import annotations

import time
from typing import TypeAlias

from waam_msgs.srv import ComputeFeed
from waam_node import node
from waam_process import materials
from waam_process.segment import Clamp

from . import answers
from .feed.feed_forward import SetpointError
from .feed.params import FeedParams

Response: TypeAlias = ComputeFeed.Response
CLAMPS = {
    'speed': Clamp.SPEED_LOW | Clamp.SPEED_HIGH,
    'feed': Clamp.FEED_LOW | Clamp.FEED_HIGH,
    'voltage': Clamp.VOLTAGE,
    'psi': Clamp.PSI,
}


class FeedForward(node.WaamNode):
    """Serves ~/compute."""

    def __init__(self) -> None:
        super().__init__('feed_forward', FeedParams)
        self.table = materials.load(self.params.materials_file or None)
        self.create_service(ComputeFeed, '~/compute', self.on_compute)
        self.counts = {'computed': 0, 'refused': 0, 'segments': 0}

    def on_compute(self, request: ComputeFeed.Request, response: Response) -> Response:
        """The service: the same segments with their setpoints, or an error code and a text that names the segment."""
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
        """The response with an error code; segments stay as they were."""
        self.counts['refused'] += 1
        self.values |= self.counts
        response.error_code, response.message = code, str(error)
        self.get_logger().error(f'refused: {error}')
        return response

    def compute(self, request: ComputeFeed.Request) -> None:
        """Writes the setpoints into request.segments. Errors leave them untouched."""
        result = answers.set_feed(self.params, request)
        for name, bits in CLAMPS.items():
            self.values[f'last_clamps_{name}'] = result.count(bits)


def main() -> None:
    node.main(FeedForward)
