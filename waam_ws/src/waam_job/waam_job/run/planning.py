"""From the scan to the plan of a pass, and what can be said of it before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from waam_plan.agreement import check
from waam_plan.import_gcode.plan_of import plan_program
from waam_plan.layers.build import plan_build
from waam_plan.layers.restore import plan_restoration, plan_top_up
from waam_plan.mesh.surface import top_surface
from waam_plan.plan import Plan, PlannedLayer
from waam_plan.settings import PlanSettings
from waam_plan.shaft.surfaces import nominal_of
from waam_process.grid import GridSpec, HeightGrid
from waam_process.loop_mode import LoopMode

from ..model.goal import Checked, Code, JobError

NO_GROUND = 4e-3  # m below the lowest layer: no bead of it reaches the ground there
BARE_AREA = 1e-5  # m2, less is an edge or a cell that was measured badly


def make_plan(
    checked: Checked,
    settings: PlanSettings,
    found: HeightGrid,
    laid: int = 0,
    below: np.ndarray | None = None,
    low: np.ndarray | None = None,
) -> Plan:
    """What is to be laid on the surface `found`, when `laid` layers of the job lie there already.

    below: (n, 2) m, arc starts of the last of them; low: bool (rows, cols), what of a machined restoration is to be
    topped up, None = all of it is planned. JobError when it cannot be planned.
    """
    part, goal = checked.part, checked.goal
    try:
        if checked.program is not None:
            nominal = top_surface(part.mesh, found.spec, checked.offset) if part else None
            return plan_program(
                checked.program,
                settings,
                found,
                nominal,
                layers=goal.layers,
                mode=goal.mode,
                level=goal.loop_mode == LoopMode.CLOSED_LOOP,
            )
        assert part is not None  # a job without a program has one
        if goal.mode == 'build':
            return plan_build(part, settings, goal.layers, found.spec)
        told: list[str] = []
        if settings.unrolled:
            nominal, run_out = nominal_of(part, found, settings)
            told = [run_out.text]
        else:
            nominal = top_surface(part.mesh, found.spec, checked.offset)
        check(found, nominal, settings, bottom=0.0)
        if low is not None:
            return plan_top_up(found, nominal, settings, low, laid, below)
        wanted = max(1, goal.layers - laid) if goal.layers else 0
        plan = plan_restoration(found, nominal, settings, wanted, laid, below)
        return replace(plan, remarks=[*told, *plan.remarks])
    except ValueError as e:
        raise JobError(Code.PLAN_FAILED, str(e)) from None


def check_ground(plan: Plan, found: HeightGrid) -> None:
    """Whether a build has its plate under all of its lowest layer. JobError with the place where it has none.

    found: the map before the first layer, on the grid of the plan; cells that were not seen do not count.
    """
    first = plan.layers[0]
    wanted = np.nan_to_num(first.target_before, nan=0.0)
    deep = np.where(first.planned > 0, wanted - found.z, 0.0)
    bare = np.nan_to_num(deep, nan=0.0) > NO_GROUND
    if bare.sum() * found.spec.resolution**2 < BARE_AREA:
        return
    rows, cols = np.nonzero(bare)
    box = found.spec.x[[cols.min(), cols.max()]], found.spec.y[[rows.min(), rows.max()]]
    (x0, x1), (y0, y1) = (1e3 * ends for ends in box)
    share = bare.sum() / (first.planned > 0).sum()
    raise JobError(
        Code.PLAN_FAILED,
        f'no plate under {share:.0%} of the first layer: in x {x0:.0f} to {x1:.0f}, y {y0:.0f} to {y1:.0f} mm the '
        f'surface is {1e3 * np.median(deep[bare]):.1f} mm below work zero; use a larger plate, or move the part or '
        'the plate (plate_zero)',
    )


def build_ahead(
    checked: Checked, settings: PlanSettings, spec: GridSpec, spool: float | None
) -> tuple[Plan | None, list[JobError]]:
    """The plan of a build, which needs no scan, and everything that is wrong with it.

    spool: m of wire, None = not known. For a part that cannot be planned, its volume gives the least length of wire.
    """
    try:
        plan = make_plan(checked, settings, HeightGrid.full(spec, 0.0))
    except JobError as e:
        volume = checked.part.report.volume if checked.part else math.nan
        known = math.isfinite(volume) and not checked.goal.layers
        return None, [e, *wire_problems(wire_of_volume(volume, settings) if known else 0.0, spool)]
    return plan, wire_problems(plan.wire, spool)


def wire_of_volume(volume: float, settings: PlanSettings) -> float:
    """m of wire for m3 of metal."""
    return volume / (settings.wire_area * settings.efficiency)


def wire_of(layers: Iterable[PlannedLayer], settings: PlanSettings) -> float:
    """m of wire that the segments of the layers ask for."""
    return wire_of_volume(sum(layer.volume for layer in layers), settings)


def wire_problems(needed: float, spool: float | None) -> list[JobError]:
    """Whether the spool (m, None = not known) holds the wire that is needed (m)."""
    if spool is None or needed <= spool:
        return []
    text = f'{needed:.1f} m of wire are needed, {max(0.0, spool):.1f} m are on the spool'
    return [JobError(Code.MACHINE_NOT_READY, text)]
