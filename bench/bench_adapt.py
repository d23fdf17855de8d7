"""The correction server beside a running job.

adapt.service_p99_ms: round trip of the real service, 256 x 256 cells, new beads in every call, announced beforehand as
  a job does and as warm as the layer before, conversion included (baseline: what was asked). stderr also has calls that
  were not announced.
WAAM_BENCH_LAW (default: that of correction_server) the law, WAAM_BENCH_CALLS (default 300) service calls.
"""

from __future__ import annotations

import math
import os
import sys
import time

import numpy as np
from lib.emit import emit
from lib.node import NodeUnderTest, memory_mb

CALLS = int(os.environ.get('WAAM_BENCH_CALLS', '300'))
SIZE = 256
PREPARATION_S = 0.5  # of wall time, as while the layer before is laid; a job has minutes
WARM = 3  # calls that warm caches


def request(node, number: int):
    """A pad of 28 x 28 beads' widths with an uneven surface, another one for every number, and its beads."""
    from waam_msgs.srv import ComputeCorrection
    from waam_node.conversions import floats, grid_to_msg, paths_to_msg
    from waam_process.grid import GridSpec

    spec = GridSpec(0.0, 0.0, 0.7e-3, SIZE, SIZE)
    rng = np.random.default_rng(number)
    x, y = np.meshgrid(spec.x, spec.y)
    wave = 0.3e-3 * np.sin(x / 17e-3 + rng.uniform(0, 6)) * np.cos(y / 13e-3 + rng.uniform(0, 6))
    z = wave + 30e-6 * rng.standard_normal(spec.shape)
    z[rng.random(spec.shape) < 0.01] = np.nan
    inside = np.zeros(spec.shape, bool)
    inside[8:-8, 8:-8] = True
    r = ComputeCorrection.Request(
        job_id=f'bench{number}', layer=1, bead_width=6e-3, temperature=150.0
    )
    r.map.header.stamp = node.get_clock().now().to_msg()
    r.map.job_id, r.map.layer, r.map.plausible = r.job_id, 0, True
    r.map.grid = grid_to_msg(spec)
    r.map.z, r.map.sigma = floats(z), floats(np.full(spec.shape, 3e-5))
    r.target = floats(np.where(inside, 0.0, np.nan))
    r.planned_height = floats(np.where(inside, 2e-3, 0.0))
    r.k_gain, r.direction.x = math.nan, 1.0
    r.paths = paths_to_msg([np.array(b) for b in zigzag(spec, number)])
    return r


def zigzag(spec, turn: int) -> list[list[tuple[float, float]]]:
    """The pad's beads in segments of 2 mm, turned round and moved a little with every layer: none comes back."""
    low, high = 8 * spec.resolution, (spec.cols - 8) * spec.resolution
    x = np.linspace(low, high, round((high - low) / 2e-3) + 1)
    rows = np.arange(low + 2.2e-3, high, 4.4e-3) + 1e-6 * turn
    return [
        [(float(v), float(y)) for v in (x if (i + turn) % 2 else x[::-1])]
        for i, y in enumerate(rows)
    ]


def measure(law: str, calls: int, announced: bool = True) -> dict[str, float]:
    """p50, p99 and largest round trip in ms as the client sees it, the server's own p99, its memory, fallbacks.
    announced: every layer is told before it is asked for, as a job does."""
    from waam_msgs.msg import NextLayer
    from waam_msgs.srv import ComputeCorrection
    from waam_node import qos

    module = 'waam_adapt.correction_server_node'
    with NodeUnderTest(module, f'law:={law}', 'max_age:=1e9') as server:
        service = server.client.create_client(ComputeCorrection, 'correction_server/compute')
        next_layer = server.client.create_publisher(NextLayer, 'next_layer', qos.LATCHED)
        server.call(service, request(server.client, 0), 5.0)
        trips, inside, fallbacks = [], [], 0
        for n in range(calls + WARM):
            r = request(server.client, n)
            if announced:
                shared = ('job_id', 'layer', 'planned_height', 'bead_width', 'direction', 'paths')
                told = {name: getattr(r, name) for name in shared}
                next_layer.publish(NextLayer(grid=r.map.grid, **told))
                time.sleep(PREPARATION_S)
            begin = time.perf_counter()
            answer = server.call(service, r)
            trips.append((time.perf_counter() - begin) * 1e3)
            inside.append(answer.correction.latency * 1e3)
            fallbacks += answer.correction.fallback
        trips, inside = trips[WARM:], inside[WARM:]
        return {
            'p50': float(np.quantile(trips, 0.5)), 'p99': float(np.quantile(trips, 0.99)),
            'max': max(trips), 'server_p99': float(np.quantile(inside, 0.99)),
            'memory_mb': memory_mb(server.process.pid), 'fallbacks': fallbacks,
        }  # fmt: skip


def service() -> None:
    """The law of a job, and the explicit one; the slower one counts."""
    from waam_adapt.laws.corrector import CorrectionParams

    law = os.environ.get('WAAM_BENCH_LAW', CorrectionParams().law)
    rows = {name: measure(name, CALLS) for name in dict.fromkeys(('damped_inverse', law))}
    alone = {f'{law}, not announced': measure(law, CALLS // 3, announced=False)}
    for name, row in (rows | alone).items():
        said = ', '.join(f'{k} {v:.1f}' for k, v in row.items())
        print(f'adapt: {name}: {said} (load {os.getloadavg()[0]:.1f})', file=sys.stderr)
    name, slowest = max(rows.items(), key=lambda row: row[1]['p99'])
    note = f'limit that was asked; {name}; server {slowest["memory_mb"]:.0f} MB'
    emit('adapt.service_p99_ms', slowest['p99'], 'ms', note, 60.0)


FIGURES = {'adapt.service_p99_ms': service}
