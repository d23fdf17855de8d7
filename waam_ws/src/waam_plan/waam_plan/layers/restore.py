"""Restoration: fill what is missing between the scan and the nominal surface with conformal layers.

Layers are offsets of the nominal surface, counted from the top: the last one is everywhere and ends at nominal. The
first one at each place brings the as-found surface (depth D) to the next offset. So every surface between layers is as
smooth as the nominal one. (Sharing D evenly among round(D / h) layers looks simpler, but leaves a step in every layer
wherever the number of layers changes.) How thick the layers are: `schedule`.
"""

from __future__ import annotations

import math

import numpy as np

from waam_plan import agreement, finish, masks
from waam_plan.fill.linking import arc_starts, near_starts
from waam_plan.layers.restored_layers import Restoration, layers_of
from waam_plan.layers.schedule import Schedule, finish_height
from waam_plan.layers.unreached import warn
from waam_plan.plan import (
    Plan,
    PlanError,
    PlannedLayer,
    check_reach,
)
from waam_plan.settings import JUDGED_RIM, PlanSettings
from waam_plan.shaft import lines
from waam_process.grid import HeightGrid

TOP_UP_RUN_OUT_WIDTHS = (
    0.75  # bead widths around a low place: at a corner less is too small for a bead
)
MIN_TOP_UP = 1.5  # least thickness of a top-up over that of the thinnest layer


def plan_restoration(
    as_found: HeightGrid,
    nominal: HeightGrid,
    settings: PlanSettings,
    layers: int = 0,
    laid: int = 0,
    below: np.ndarray | None = None,
) -> Plan:
    """Plan the metal between `as_found` and `nominal` (m, same grid, work frame, NaN = unknown or outside).

    layers: greatest number of layers, counted from the bottom; 0 = all. Asking for more than there are gives a
    warning. laid: number of layers already laid; directions and starts continue to alternate from them, numbers begin
    at 1. below: (n, 2) m, arc starts of the last layer laid.
    Raises PlanError when the grids differ, the scan does not lie on the part (`agreement`) or the machine cannot reach.
    """
    if layers < 0:
        raise PlanError(f'layers is {layers}, must be 0 (all) or a positive number')
    if only := settings.of_builds():
        raise PlanError(f'{", ".join(only)}: only a build knows this, a restoration does not')
    warnings: list[str] = []
    found = _known_surface(as_found, nominal, settings, warnings)
    smooth = _smooth(found, nominal, settings)
    needed = finish.needed_area(as_found, nominal)
    counted = needed
    if settings.unrolled:  # each place of a shaft once
        counted = needed & settings.unrolled.first_turn(nominal.spec)
    settings, above, remarks = _finished(counted, nominal, settings)
    wanted = nominal.z + above
    depth = wanted - smooth
    if settings.finish == finish.MACHINED:
        aside = finish.edges(counted, nominal).warning
        warnings += [aside] if aside else []
        near = _with_run_out(needed, nominal, settings, finish.RUN_OUT_WIDTHS)
        depth = np.where(near | np.isnan(depth), depth, 0.0)
    job = Restoration.of(as_found, nominal, settings, found, smooth, wanted, depth, laid)
    total = int(job.count.max(initial=0))
    if layers > total:
        warnings.append(f'{layers} layers were asked for, {total} are needed')
    use = min(layers, total) if layers else total
    planned, filled = layers_of(job, total, use, _starts(below))
    warn(job, planned, use == total, nominal, warnings)
    plan = _plan(job, planned, as_found, nominal, below, warnings)
    left = finish.unlaid(counted, plan.region, nominal.z - found, nominal.spec)
    if left.area:
        warnings.append(left.text)
    plan.remarks.extend([*_remarks(job.schedule, filled, settings), *remarks])
    return plan


def plan_top_up(
    surface: HeightGrid,
    nominal: HeightGrid,
    settings: PlanSettings,
    low: np.ndarray,
    laid: int,
    below: np.ndarray | None,
) -> Plan:
    """Plan what brings the cells `low` (bool) of a restored surface above nominal: beads on them and the run-out around
    them, MIN_TOP_UP thick at least, over free sides as those of the layers before, but not on humps.

    Surfaces, `laid`, `below` and errors as of `plan_restoration`; the settings have finish machined. No layers: too
    narrow for a bead.
    """
    warnings: list[str] = []
    found = _known_surface(surface, nominal, settings, warnings)
    smooth = _smooth(found, nominal, settings)
    settings, above, _ = _finished(low, nominal, settings)
    near = _with_run_out(low, nominal, settings, TOP_UP_RUN_OUT_WIDTHS)
    thin = MIN_TOP_UP * settings.min_layer * (finish_height(settings) or settings.layer_height)
    wanted = nominal.z + above
    near &= low | ~(smooth > wanted + thin)  # no hump grows on one
    wanted = np.where(near, np.fmax(wanted, smooth + thin), wanted)
    depth = np.where(near | np.isnan(wanted), wanted - smooth, 0.0)
    job = Restoration.of(surface, nominal, settings, found, smooth, wanted, depth, laid)
    total = int(job.count.max(initial=0))
    planned, _ = layers_of(job, total, total, _starts(below))
    return _plan(job, planned, surface, nominal, below, warnings)


def _plan(
    job: Restoration,
    planned: list[PlannedLayer],
    as_found: HeightGrid,
    nominal: HeightGrid,
    below: np.ndarray | None,
    warnings: list[str],
) -> Plan:
    """The plan of these layers; `warnings` is kept and added to. PlanError when the machine cannot reach."""
    settings, res = job.settings, job.spec.resolution
    region = np.any([p.footprint for p in planned], axis=0) if planned else job.count > 0
    counted = np.ones(region.shape, bool)
    if settings.unrolled:  # each place of a shaft counts once
        counted &= settings.unrolled.first_turn(job.spec)
    starts = [
        _starts(below),
        *(lines.home_points(arc_starts(p.segments), settings) for p in planned),
    ]
    warnings += near_starts(starts, settings.start_spread, first=0)
    judged = masks.judged(region, JUDGED_RIM / res, settings.bead_width / res)
    check_reach([s for layer in planned for s in layer.segments], settings)
    return Plan(
        job.spec,
        as_found,
        nominal,
        region & counted,
        judged & ~masks.flanks(job.wanted, res) & counted,
        planned,
        job.safe_z,
        settings,
        warnings=warnings,
    )


def _starts(below: np.ndarray | None) -> np.ndarray:
    return np.zeros((0, 2)) if below is None else below


def _with_run_out(
    needed: np.ndarray, nominal: HeightGrid, settings: PlanSettings, widths: float
) -> np.ndarray:
    """bool: the needed area of a machined finish and the metal around it, so many bead widths."""
    cells = math.ceil(widths * settings.bead_width / nominal.spec.resolution)
    return finish.with_run_out(needed, nominal.z, cells)


def _known_surface(
    as_found: HeightGrid, nominal: HeightGrid, settings: PlanSettings, warnings: list[str]
) -> np.ndarray:
    """As-found heights on the part, small unknown patches filled from their neighbours, NaN off the part."""
    if as_found.spec != nominal.spec:
        raise PlanError(f'the scan lies on {as_found.spec}, the nominal surface on {nominal.spec}')
    part = np.isfinite(nominal.z)
    if not part.any():
        raise PlanError('the nominal surface is empty: does the part lie inside the grid?')
    agreement.check(as_found, nominal, settings)
    unknown = part & ~np.isfinite(as_found.z)
    share = unknown.sum() / part.sum()
    if unknown.any():
        place = masks.largest(unknown, nominal.spec)
        warnings.append(
            f'{share:.1%} of the part was not seen by the scan, {place}; filled from neighbours'
        )
    return np.where(part, masks.fill_unknown(as_found.z), np.nan)


def _finished(
    needed: np.ndarray, nominal: HeightGrid, settings: PlanSettings
) -> tuple[PlanSettings, np.ndarray | float, list[str]]:
    """Settings with what a machined finish needs, metal wanted above nominal (m), and what is said of it."""
    if settings.finish != finish.MACHINED:
        return settings, settings.allowance, []
    ahead = finish.forecast(finish_height(settings) or settings.layer_height)
    more = finish.along_sides(needed, nominal)
    given = settings.allowance != 0
    allowance = settings.allowance if given else ahead.allowance
    above = allowance + (0.0 if given else more)
    return (
        finish.for_machining(settings, allowance),
        above,
        [ahead.text(allowance, given, bool(more.any()))],
    )


def _smooth(found: np.ndarray, nominal: HeightGrid, settings: PlanSettings) -> np.ndarray:
    window = settings.smoothing * settings.bead_width / nominal.spec.resolution
    missing = masks.smooth_surface(
        nominal.z - found, window, 0.5 * settings.min_layer * settings.layer_height
    )
    return nominal.z - missing


def _remarks(schedule: Schedule, filled: list[str], settings: PlanSettings) -> list[str]:
    """What was chosen; filled: the strategy of every layer."""
    told = [schedule.reason(settings)] if filled else []
    if hatched := [str(i) for i, name in enumerate(filled, 1) if name != settings.strategy]:
        layers = f'layer{"s" if len(hatched) > 1 else ""} {", ".join(hatched)}'
        told.append(f'{layers} in parallel beads: rings would lie less evenly there')
    return told
