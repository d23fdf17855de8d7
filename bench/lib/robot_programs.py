"""Programs for robots for bench_robot.py: parts of the planner in three languages, read back and run on the robot."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from waam_plan.cli_robot import POSTS, language
from waam_plan.lay.build import plan_build
from waam_plan.lay.restore import plan_restoration
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan
from waam_plan.robot.cell import RobotCell
from waam_plan.robot.motion import TOLERANCE
from waam_plan.robot.run import check
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid

POSITIONERS = ('none', 'turn')


def plans() -> Iterator[tuple[str, Plan]]:
    """A disc in rings, in a zig-zag and in a spiral, a tube, a block, a worn block."""
    disc = trimesh.creation.cylinder(radius=22, height=6, sections=96)
    tube = trimesh.creation.annulus(r_min=24, r_max=33, height=6, sections=128)
    block = trimesh.creation.box(extents=(50, 30, 6))
    yield 'disc in rings', _build(disc, 'contour')
    yield 'disc in a zig-zag', _build(disc, 'zigzag')
    yield 'disc in a spiral', _build(disc, 'spiral')
    yield 'tube', _build(tube, 'solid')
    yield 'block', _build(block, 'combined')
    yield 'worn block', _worn()


def _build(mesh: trimesh.Trimesh, strategy: str) -> Plan:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'part.stl'
        mesh.export(file)
        return plan_build(load_part(file), PlanSettings(strategy=strategy), 2)


def _worn() -> Plan:
    spec = GridSpec.covering(-0.005, -0.005, 0.065, 0.045, 0.5e-3)
    x, y = np.meshgrid(spec.x, spec.y)
    part = (x > 0) & (x < 0.06) & (y > 0) & (y < 0.04)
    nominal = np.where(part, 0.03, np.nan)
    found = nominal - (0.003 + 0.002 * np.sin(x / 0.008))
    return plan_restoration(HeightGrid(spec, found), HeightGrid(spec, nominal), PlanSettings())


@dataclass(frozen=True)
class Found:
    """um between the path of the robot and that of the plan, degrees between the torches."""

    part: str
    post: str
    positioner: str
    path_um: float
    lean_deg: float


def programs() -> Iterator[Found]:
    """All parts, languages and positioners."""
    for name, plan in plans():
        x0, x1, y0, y1 = plan.spec.extent
        origin = (-(x0 + x1) / 2, -(y0 + y1) / 2, 0.0)
        for positioner in POSITIONERS:
            cell = RobotCell(positioner=positioner, origin=origin)
            for post in POSTS:
                write, read = language(post)
                files = write(plan, cell=cell, tolerance=TOLERANCE)
                found = check(plan, read(files, cell=cell), cell)
                lean = float(np.degrees(found.lean))
                yield Found(name, post, positioner, found.path * 1e6, lean)
