"""Planning: how long it takes.

plan.million_points_s: wall time to plan 10^6 path points; plan.million_points_memory_gb: its peak memory;
plan.million_points_exponent: of time over points.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys

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


FIGURES = {
    'plan.million_points_s': million,
    'plan.million_points_memory_gb': million,
    'plan.million_points_exponent': million,
}
