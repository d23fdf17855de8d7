"""Parts with an overhang for bench_robot.py: a post, and an arm that leans off it, to be built with the part tilted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from .preset import preset

# mm: along y; of the post along x and z; of the arm over the ground
WIDTH, POST, HIGH, ROOT = 70.0, 12.0, 60.0, 20.0


def _prism(corners: list) -> trimesh.Trimesh:
    """Over corners (n, 2) in x and z, WIDTH along y."""
    flat = np.array(corners, float)
    ends = [np.column_stack([flat[:, 0], np.full(len(flat), y), flat[:, 1]]) for y in (0.0, WIDTH)]
    return trimesh.convex.convex_hull(np.concatenate(ends))


def write(
    degrees: float, folder: Path, thick: float = 12.0, long: float = 16.0
) -> tuple[Path, Path]:
    """(part, as found): STL files (mm) of post and arm, and of the post. The arm leans by `degrees` from the upright to
    +x, `thick` across and at least `long` along it, with an end square to it."""
    t = np.radians(degrees)
    along, across = np.array([np.sin(t), np.cos(t)]), np.array([-np.cos(t), np.sin(t)])
    low = np.array([POST, ROOT])
    high = low + thick * across
    high = high + (POST - high[0]) / along[0] * along  # on the face of the post
    end = max(low @ along, high @ along) + long
    tips = [p + (end - p @ along) * along for p in (low, high)]
    inside = [p - [POST / 2, 0] for p in (low, high)]
    post = _prism([(0, 0), (POST, 0), (POST, HIGH), (0, HIGH)])
    folder.mkdir(parents=True, exist_ok=True)
    files = folder / f'arm_{degrees:g}.stl', folder / f'post_{degrees:g}.stl'
    trimesh.util.concatenate([post, _prism([*inside, low, high, *tips])]).export(files[0])
    post.export(files[1])
    return files


@dataclass(frozen=True)
class Wall:
    """rms: m; contacts: of torch and arm with part and positioner, as the plan was checked."""

    rms: float
    contacts: int
    said: str


def build(degrees: float, seed: int, folder: Path) -> Wall:
    """The arm on the post, tilted by its own overhang, in the laboratory."""
    from waam_lab import restore, run

    part, found = write(degrees, folder)
    tilt = float(np.radians(degrees))
    job = restore(
        part, found, seed, machine='robot', plan_settings=(f'tilt_deg={degrees:g}', 'clamp=true'),
        overrides={'robot_bridge': {'tilt': tilt}, 'cell': {'robot_tilt': tilt}}, preset=preset(),
    )  # fmt: skip
    result = run(job)
    said = result.message if result.failed else f'{result.rms * 1e3:.3f} mm, {result.layers} layers'
    return Wall(result.rms, contacts(part, found, degrees), said)


def contacts(part: Path, found: Path, degrees: float) -> int:
    """Of the plan on the robot."""
    from waam_lab.robot.robot_check import check
    from waam_plan.layers.restore import plan_restoration
    from waam_plan.mesh.inputs import of_part
    from waam_plan.mesh.part import load_part
    from waam_plan.settings import PlanSettings
    from waam_robot_bridge.params import RobotParams

    settings = PlanSettings(tilt_deg=degrees, clamp=True)
    surfaces = of_part(load_part(part, require_closed=False), found, 1e-3, settings, False)
    plan = plan_restoration(surfaces.found, surfaces.nominal, settings)
    told = check(plan, RobotParams(tilt=float(np.radians(degrees))))
    if told.problem or told.unchecked:
        raise SystemExit(f'robot.overhang_deg: {told.problem or told.unchecked}')
    return len(told.contacts)
