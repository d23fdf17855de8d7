"""Every recorded mesh with every strategy: a program that keeps to its section, or a refusal that says where."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from .paths import DATA
from .plan_checks import Found, check

MESHES = DATA / 'meshes'
LAYERS = int(os.environ.get('WAAM_PLAN_LAYERS', '4'))  # checked of each program; 0 = all
STRATEGIES = ('solid', 'zigzag', 'contour', 'spiral', 'combined', 'medial')
PLACE = re.compile(r'-?\d+\.\d+ mm|-?\d+\.\d+\) mm|boundary edges')


@dataclass(frozen=True)
class Case:
    """A mesh with what it takes to build it; `scale` in m per unit, `settings` of PlanSettings."""

    mesh: str
    scale: float = 1e-3
    settings: dict = field(default_factory=dict)
    strategies: tuple[str, ...] = STRATEGIES


FINE = {'bead_width': 2.5e-3, 'layer_height': 1e-3, 'grid': 0.25e-3}
CASES = (
    Case('branches_70_closed_low_res', settings=FINE),
    Case('bunny_closed_low_res'),
    Case('distorted_v_closed_mid_res'),
    Case('overhang_coin_closed_low_res'),
    Case('simple_vase_open_low_res', strategies=('shell',)),
)
TALL = {'machine_max': (0.3, 0.22, 0.4), 'foot_height': 0.0, 'overhang': 'flag'}


@dataclass
class Result:
    """Over all programs; `refused` has the text of every refusal that names no place."""

    programs: int = 0
    refusals: int = 0
    vague: list[str] = field(default_factory=list)
    worst: Found = field(default_factory=lambda: Found(1.0, 1.0, 0.0, 0.0, np.inf))
    where: str = ''


def run() -> Result:
    """All cases; first as they are (a refusal is fine if it says where), then with overhangs flagged."""
    out = Result()
    for case in CASES:
        for strategy in case.strategies:
            _as_it_is(case, strategy, out)
            _flagged(case, strategy, out)
    return out


def _as_it_is(case: Case, strategy: str, out: Result) -> None:
    """Plan with the defaults of a machine: what it refuses must have a name and a place."""
    try:
        _plan(case, {}, strategy, LAYERS)
    except ValueError as error:
        out.refusals += 1
        if not PLACE.search(str(error)):
            out.vague.append(str(error))


def _flagged(case: Case, strategy: str, out: Result) -> None:
    try:
        plan, mesh = _plan(case, {**case.settings, **TALL}, strategy, LAYERS)
    except ValueError as error:
        out.refusals += 1
        if not PLACE.search(str(error)):
            out.vague.append(f'{case.mesh} {strategy}: {error}')
        return
    found = check(plan, [_section(mesh, layer, plan.settings) for layer in plan.layers])
    out.programs += 1
    if found.coverage < out.worst.coverage:
        out.where = f'{case.mesh} {strategy}'
    out.worst = Found(
        min(found.coverage, out.worst.coverage),
        min(found.in_range, out.worst.in_range),
        max(found.outside, out.worst.outside),
        max(found.idle_depth, out.worst.idle_depth),
        min(found.starts_apart, out.worst.starts_apart),
    )
    if os.environ.get('WAAM_PLAN_VERBOSE'):
        print(case.mesh, strategy, len(plan.layers), plan.arc_starts, found, flush=True)


def _plan(case: Case, overrides: dict, strategy: str, layers: int):
    from waam_plan.layers.build import plan_build
    from waam_plan.mesh.part import load_part
    from waam_plan.settings import PlanSettings

    settings = PlanSettings(strategy=strategy, **overrides)
    closed = strategy != 'shell'
    part = load_part(MESHES / f'{case.mesh}.stl', case.scale, require_closed=closed)
    plan = plan_build(part, settings, layers)
    return replace(plan, name=case.mesh), part.moved(plan.offset).mesh


def _section(mesh, layer, settings) -> list:
    """Polygons of the mesh in the middle of a layer, cut by trimesh and closed by shapely."""
    import trimesh

    z = float(np.nanmax(layer.target_after) - layer.planned.max() / 2)
    cut = trimesh.intersections.mesh_plane(mesh, (0, 0, 1), (0, 0, z + 1e-7))[:, :, :2]
    lines = shapely.linestrings(np.round(cut, 8))
    rings = shapely.get_parts(shapely.line_merge(shapely.union_all(lines)))
    if settings.strategy == 'shell':
        return [shapely.union_all(rings).buffer(settings.pitch / 2)]
    shape = shapely.Polygon()
    for ring in rings:
        if ring.is_closed:
            shape = shape.symmetric_difference(shapely.make_valid(shapely.Polygon(ring)))
    return [shape]
