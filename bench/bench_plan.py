"""Planning: programs that keep to their section, very long ones, compact ones.

plan.coverage_min: least share of a section under beads, all recorded meshes with all strategies (baseline: asked for;
0 when a path leaves its section by more than 1 um, an idle move goes through simulated metal or a refusal names no
place). plan.overlap_min: least share of a section in which neighbouring beads are neither too near nor too far;
plan.starts_apart_min_mm: of arc starts of neighbouring layers. WAAM_PLAN_LAYERS: layers checked of each program
(default 4; 0 = all, about an hour).
plan.million_points_s: wall time to plan 10^6 path points; plan.million_points_memory_gb: its peak memory;
plan.million_points_exponent: of time over points.
plan.compact_saving: share of points saved on a prismatic part at equal geometry (baseline: what is asked for);
plan.compact_time_s: time to plan and write it with equal layers planned once (baseline: every layer planned).
plan.restore_time_s: processor time to plan a restoration of 100 x 60 mm in six layers (baseline: asked for).
plan.restore_flat_share: recorded worn surface, restored on the simulated cell: share of the area within 0.2 mm;
plan.restore_flat_p95_mm: 95 % of the area are closer than this.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from lib.emit import emit
from lib.paths import LIB

LAYERS = 40
MICROMETRE = 1e-6


def compact() -> None:
    """A cylinder of 60 mm, 40 layers."""
    import trimesh

    from waam_plan.gcode.compact import fragments, saving
    from waam_plan.mesh.part import load_part
    from waam_plan.settings import PlanSettings

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'prism.stl'
        trimesh.creation.cylinder(radius=30, height=2 * LAYERS, sections=128).export(file)
        part = load_part(file)
    plan, once = timed(part, PlanSettings())
    emit('plan.compact_saving', saving(plan, fragments(plan)).share, '1', 'asked for', 0.8)
    _, every = timed(part, PlanSettings(growth_step=0.0))
    emit('plan.compact_time_s', once, 's', 'every layer planned', every)


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


def coverage() -> None:
    """All recorded meshes with all strategies."""
    from lib.plan_coverage import MESHES, run

    if not MESHES.is_dir():
        print(f'plan.coverage_min: no {MESHES}', file=sys.stderr)
        return
    found = run()
    for text in found.vague:
        print(f'refusal without a place: {text}', file=sys.stderr)
    worst = found.worst
    good = worst.outside <= MICROMETRE and worst.idle_depth <= MICROMETRE and not found.vague
    if not good:
        print(f'{found.where}: {worst}', file=sys.stderr)
    emit('plan.coverage_min', worst.coverage if good else 0.0, '1', 'asked for', 0.99)
    emit('plan.overlap_min', worst.in_range, '1', 'all of it', 1.0)
    emit('plan.starts_apart_min_mm', worst.starts_apart * 1e3, 'mm', 'asked for', 5.0)


def restoration() -> None:
    """The recorded wall as the worn surface."""
    from lib.plan_restoration_wall import CLOUD, run

    if not CLOUD.is_file():
        print(f'plan.restore_flat_share: no {CLOUD}', file=sys.stderr)
        return
    result = run()
    emit('plan.restore_flat_share', result.share, '1', 'asked for', 0.95)
    emit('plan.restore_flat_p95_mm', result.p95 * 1e3, 'mm', 'asked for', 0.2)
    print(f'layers {result.layers}, edges apart: {result.edges}', file=sys.stderr)


def restore_time() -> None:
    """A block with a ragged surface 12 mm below its nominal one; the best of three."""
    import numpy as np

    from waam_plan.layers.restore import plan_restoration
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


def timed(part, settings):
    """(plan, seconds) with the compact program written."""
    from waam_plan.layers.build import plan_build
    from waam_plan.robot.fanuc import write_ls

    start = time.perf_counter()
    plan = plan_build(part, settings)
    write_ls(plan)
    return plan, time.perf_counter() - start


FIGURES = {
    'plan.compact_saving': compact,
    'plan.compact_time_s': compact,
    'plan.million_points_s': million,
    'plan.million_points_memory_gb': million,
    'plan.million_points_exponent': million,
    'plan.coverage_min': coverage,
    'plan.overlap_min': coverage,
    'plan.starts_apart_min_mm': coverage,
    'plan.restore_time_s': restore_time,
    'plan.restore_flat_share': restoration,
    'plan.restore_flat_p95_mm': restoration,
}
