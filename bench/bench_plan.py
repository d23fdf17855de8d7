"""Planning: how long it takes.

plan.million_points_s: wall time to plan 10^6 path points; plan.million_points_memory_gb: its peak memory;
plan.million_points_exponent: of time over points.
plan.restore_time_s: processor time to plan a restoration of 100 x 60 mm in six layers (baseline: asked for).
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time

from lib.emit import emit
from lib.paths import LIB


def million() -> None:
    """An eighth of the points and all of them, each in a process of its own; scaled to exactly 10^6."""
    few, many = planned(125_000), planned(1_000_000)
    scale = 1e6 / many['points']
    emit('plan.million_points_s', many['wall'] * scale, 's', 'asked for', 20.0)
    emit('plan.million_points_memory_gb', many['peak'] / 1e9, 'GB', 'asked for', 2.0)
    exponent = math.log(many['cpu'] / few['cpu']) / math.log(many['points'] / few['points'])
    emit('plan.million_points_exponent', exponent, '1', 'linear', 1.0)


def planned(points: int) -> dict:
    """Figures of plan_million.py."""
    script = LIB / 'plan_million.py'
    found = subprocess.run(
        [sys.executable, str(script), str(points)], capture_output=True, text=True, check=True
    )
    return json.loads(found.stdout.splitlines()[-1])


def restore_time() -> None:
    """A block with a ragged surface 12 mm below its nominal one; the best of three."""
    import numpy as np

    from waam_plan.lay.restore import plan_restoration
    from waam_plan.settings import PlanSettings
    from waam_process.grid import GridSpec, HeightGrid

    spec = GridSpec.covering(-0.005, -0.005, 0.105, 0.065, 0.5e-3)
    x, y = np.meshgrid(spec.x, spec.y)
    nominal = np.where((x > 0) & (x < 0.1) & (y > 0) & (y < 0.06), 0.02, np.nan)
    found = HeightGrid(spec, nominal - 0.012 - 1e-4 * np.sin(1e3 * x))
    taken = []
    for _ in range(3):
        start = time.process_time()
        plan = plan_restoration(found, HeightGrid(spec, nominal), PlanSettings())
        taken.append(time.process_time() - start)
    if len(plan.layers) != 6:
        raise SystemExit(f'plan.restore_time_s: {len(plan.layers)} layers instead of six')
    emit('plan.restore_time_s', min(taken), 's', 'asked for', 2.0)


FIGURES = {
    'plan.million_points_s': million,
    'plan.million_points_memory_gb': million,
    'plan.million_points_exponent': million,
    'plan.restore_time_s': restore_time,
}
