"""Planning: compact programs beside plain ones.

plan.compact_saving: share of points saved on a prismatic part at equal geometry (baseline: what is asked for);
plan.compact_time_s: time to plan and write it with equal layers planned once (baseline: every layer planned).
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from emit import emit

NAMES = ['plan.compact_saving', 'plan.compact_time_s']
LAYERS = 40


def main() -> None:
    """A cylinder of 60 mm, 40 layers."""
    import trimesh

    from waam_plan.compact import fragments, saving
    from waam_plan.part import load_part
    from waam_plan.settings import PlanSettings

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'prism.stl'
        trimesh.creation.cylinder(radius=30, height=2 * LAYERS, sections=128).export(file)
        part = load_part(file)
    plan, once = timed(part, PlanSettings())
    emit('plan.compact_saving', saving(plan, fragments(plan)).share, '1', 'asked for', 0.8)
    _, every = timed(part, PlanSettings(growth_step=0.0))
    emit('plan.compact_time_s', once, 's', 'every layer planned', every)


def timed(part, settings):
    """(plan, seconds) with the compact program written."""
    from waam_plan.build import plan_build
    from waam_plan.fanuc import write_ls

    start = time.perf_counter()
    plan = plan_build(part, settings)
    write_ls(plan)
    return plan, time.perf_counter() - start


if __name__ == '__main__':
    main()
