"""Planning: how long it takes.

plan.million_points_s: wall time to plan 10^6 path points; plan.million_points_memory_gb: its peak memory;
plan.million_points_exponent: of processor time over points.
"""

from __future__ import annotations

import math
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

from lib.emit import emit

TAPER = 0.9  # every layer differs from the one below, so none is repeated
LAYER = 1.5e-3
POINTS_PER_LAYER = 12_800  # of the whole base, with stations of 1 mm


def planned(points: int) -> tuple[int, float, float, float]:
    """Points, s of wall and of processor time, peak memory in GB of the plan of a tapered block of 280 x 200 mm, as
    high as the points need."""
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
    wall, cpu = time.perf_counter(), time.process_time()
    plan = plan_build(part, PlanSettings(layer_height=LAYER, segment_length=1e-3))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024e-9
    return sum(len(layer.deposits) for layer in plan.layers), wall, cpu, peak


def million() -> None:
    """An eighth of the points and all of them, each in a process of its own; scaled to exactly 10^6."""
    with multiprocessing.get_context('spawn').Pool(1, maxtasksperchild=1) as pool:
        few, many = (pool.apply(planned, (points,)) for points in (125_000, 1_000_000))
    emit('plan.million_points_s', many[1] * 1e6 / many[0], 's', 'asked for', 20.0)
    emit('plan.million_points_memory_gb', many[3], 'GB', 'asked for', 2.0)
    exponent = math.log(many[2] / few[2]) / math.log(many[0] / few[0])
    emit('plan.million_points_exponent', exponent, '1', 'linear', 1.0)


FIGURES = {f'plan.million_points_{name}': million for name in ('s', 'memory_gb', 'exponent')}
