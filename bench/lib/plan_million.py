"""A plan of very many points, alone in its process: prints points, seconds of wall and CPU time, peak memory."""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

TAPER = 0.9  # every layer differs from the one below, so none is repeated
LAYER = 1.5e-3
POINTS_PER_LAYER = 12_800  # of the whole base, with stations of 1 mm


def main(points: int) -> None:
    """A tapered block of 280 x 200 mm, as high as the points need."""
    import trimesh

    from waam_plan.layers.build import plan_build
    from waam_plan.mesh.part import load_part
    from waam_plan.settings import PlanSettings

    layers = max(1, round(points / POINTS_PER_LAYER))
    block = trimesh.creation.box(extents=(280, 200, layers * LAYER * 1e3))
    top = block.vertices[:, 2] > 0
    block.vertices[top, :2] *= 1 - (1 - TAPER) * layers / 80
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'block.stl'
        block.export(file)
        part = load_part(file)
    settings = PlanSettings(layer_height=LAYER, segment_length=1e-3)
    wall, cpu = time.perf_counter(), time.process_time()
    plan = plan_build(part, settings)
    found = {
        'points': sum(len(layer.deposits) for layer in plan.layers),
        'wall': time.perf_counter() - wall,
        'cpu': time.process_time() - cpu,
        'peak': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        'cell': plan.spec.resolution,
    }
    print(json.dumps(found))


if __name__ == '__main__':
    main(int(sys.argv[1]))
