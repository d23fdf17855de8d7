"""Restoration: fill what is missing between the scan and the nominal surface with conformal layers.

Layers are offsets of the nominal surface, counted from the top: the last one is everywhere and ends at nominal. The
first one at each place brings the as-found surface (depth D) to the next offset. So every surface between layers is as
smooth as the nominal one. (Sharing D evenly among round(D / h) layers looks simpler, but leaves a step in every layer
wherever the number of layers changes.) How thick the layers are: `schedule`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waam_plan import agreement, finish, masks
from waam_plan.fill import strategies
from waam_plan.fill.linking import StartsBelow, arc_starts, near_starts
from waam_plan.layers import sides
from waam_plan.layers.layer import LayerTask, lay
from waam_plan.layers.layout import best, most_even
from waam_plan.layers.schedule import Schedule, choose_schedule, finish_height, layer_count
from waam_plan.plan import (
    UNLIKE,
    Plan,
    PlanError,
    PlannedLayer,
    check_reach,
    collector_paused,
    highest,
    metal_of,
)
from waam_plan.settings import JUDGED_RIM, PlanSettings
from waam_plan.shaft import around, lines
from waam_plan.slice.section import outline
from waam_process.grid import GridSpec, HeightGrid

WALL = 1.0e-3  # m to the side of a wall, within which a height says nothing about the metal
TOP_UP_RUN_OUT_WIDTHS = (
    0.75  # bead widths around a low place: at a corner less is too small for a bead
)
MIN_TOP_UP = 1.5  # least thickness of a top-up over that of the thinnest layer
SPOT = 2e-6  # m2, smaller places are no places


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
    job = _Restoration.of(as_found, nominal, settings, found, smooth, wanted, depth, laid)
    total = int(job.count.max(initial=0))
    if layers > total:
        warnings.append(f'{layers} layers were asked for, {total} are needed')
    use = min(layers, total) if layers else total
    planned, filled = _layers(job, total, use, below)
    _warn(job, planned, use == total, nominal, warnings)
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
    job = _Restoration.of(surface, nominal, settings, found, smooth, wanted, depth, laid)
    total = int(job.count.max(initial=0))
    planned, _ = _layers(job, total, total, below)
    return _plan(job, planned, surface, nominal, below, warnings)


def _plan(
    job: _Restoration,
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


@dataclass(frozen=True)
class _Restoration:
    """What all layers are made from. Maps (rows, cols), heights in m."""

    spec: GridSpec
    count: np.ndarray  # layers at each place
    schedule: Schedule
    wanted: np.ndarray  # final surface
    found: np.ndarray  # as found, on the part
    smooth: np.ndarray
    standing: np.ndarray  # whatever was scanned, also beside the part
    safe_z: float
    laid: int  # layers below the first one
    settings: PlanSettings

    @classmethod
    def of(
        cls,
        as_found: HeightGrid,
        nominal: HeightGrid,
        settings: PlanSettings,
        found: np.ndarray,
        smooth: np.ndarray,
        wanted: np.ndarray,
        depth: np.ndarray,
        laid: int,
    ) -> _Restoration:
        """depth: (rows, cols) m of metal, NaN off the part; as_found: whatever was scanned."""
        schedule = choose_schedule(depth, settings)
        return cls(
            spec=nominal.spec,
            count=layer_count(depth, schedule, settings, nominal.spec.resolution),
            schedule=schedule,
            wanted=wanted,
            found=found,
            smooth=smooth,
            standing=as_found.z,
            safe_z=highest(as_found, HeightGrid(nominal.spec, wanted)) + settings.clearance,
            laid=laid,
            settings=settings,
        )


def _layers(
    job: _Restoration, total: int, use: int, below: np.ndarray | None
) -> tuple[list[PlannedLayer], list[str]]:
    """The layers from the bottom, and the strategy that each is filled with."""
    planned: list[PlannedLayer] = []
    filled: list[str] = []
    starts = _starts(below)
    with collector_paused():
        for number in range(1, use + 1):
            layer, strategy = _layer(job, number, total - number + 1, starts)
            planned.append(layer)
            filled.append(strategy)
            starts = arc_starts(layer.segments)
    return planned, filled


def _remarks(schedule: Schedule, filled: list[str], settings: PlanSettings) -> list[str]:
    """What was chosen; filled: the strategy of every layer."""
    told = [schedule.reason(settings)] if filled else []
    if hatched := [str(i) for i, name in enumerate(filled, 1) if name != settings.strategy]:
        layers = f'layer{"s" if len(hatched) > 1 else ""} {", ".join(hatched)}'
        told.append(f'{layers} in parallel beads: rings would lie less evenly there')
    return told


def _layer(job: _Restoration, number: int, k: int, below: np.ndarray) -> tuple[PlannedLayer, str]:
    """Layer `number`, k-th from the top, on the cells that have at least k layers, and the strategy that fills it.

    below: arc starts of the layer before, (n, 2) m.
    """
    spec, settings, wanted, schedule = job.spec, job.settings, job.wanted, job.schedule
    on = job.count >= k
    first = job.count == k
    after = np.where(on, wanted - schedule.offset(k), np.nan)
    before = np.where(on, np.where(first, job.found, wanted - schedule.offset(k + 1)), np.nan)
    planned = np.where(on, np.clip(after - before, 0.0, schedule.thickest), 0.0)
    under = np.where(first, job.smooth, wanted - schedule.offset(k + 1))
    soft = masks.blur(under, on, settings.bead_width / 4 / spec.resolution)
    turn = number + job.laid
    cover = sides.of_mask(on, first, _free(job, on), spec, settings)
    task = LayerTask(
        number=number,
        turn=turn,
        footprint=on,
        cover=cover.metal,
        planned=planned,
        before=before,
        after=after,
        ground=soft,
        metal=_metal(job, on, after),
        thickest=schedule.thickest,
        inside=None if settings.strategy in ('shell', 'zigzag') else outline(on, spec),
    )
    fillings = _fillings(settings, cover)
    laid = [_laid(task, cover, below, job.safe_z, spec, f) for f in fillings]
    chosen = best(laid, spec, settings)
    return laid[chosen], fillings[chosen].strategy


def _free(job: _Restoration, on: np.ndarray) -> np.ndarray:
    """Cells (rows, cols) bool beside a layer that its beads may run over: those beside the part, and for a machined
    finish lower ground."""
    free = np.isnan(job.wanted)
    if job.settings.finish == finish.MACHINED:
        free |= finish.free_sides(on, job.wanted)
    return free


def _laid(
    task: LayerTask,
    cover: sides.Cover,
    below: np.ndarray,
    safe_z: float,
    spec: GridSpec,
    settings: PlanSettings,
) -> PlannedLayer:
    """The layer, filled as the settings say; `below` as of `_layer`."""
    if settings.unrolled:
        settings = around.filling(settings)
        chains = around.chains_of(cover.mask, spec, settings, task.turn)
        settings = replace(settings, direction=around.direction_of(chains))
        return lay(task, chains, below, spec=spec, safe_z=safe_z, settings=settings)
    settings = _with_edges(settings, cover)
    beyond = (cover.mask & ~task.footprint).any()
    within = sides.settings_within(settings) if beyond else settings
    starts = StartsBelow(below, settings.start_spread)
    area = strategies.Area(cover.polygons, cover.mask, spec, within, task.turn, below=starts)
    chains = most_even(area, masks.spread(task.planned, task.footprint, cover.mask))
    return lay(task, chains, below, spec=spec, safe_z=safe_z, settings=settings)


def _fillings(settings: PlanSettings, cover: sides.Cover) -> list[PlanSettings]:
    """Settings of the strategies that a layer may be filled with."""
    if settings.strategy != 'solid' or settings.unrolled or _narrow(settings, cover):
        return [settings]
    return [settings, replace(settings, strategy='zigzag')]


def _narrow(settings: PlanSettings, cover: sides.Cover) -> bool:
    """Whether no place of a layer is wide enough for rings."""
    return all(strategies.is_narrow(p, settings) for p in cover.polygons)


def _with_edges(settings: PlanSettings, cover: sides.Cover) -> PlanSettings:
    """Settings with what the strategy needs along the edge of a layer, where nothing was set."""
    hatched = settings.strategy == 'solid' and _narrow(settings, cover)
    strategy = strategies.REGISTRY['zigzag' if hatched else settings.strategy]
    return replace(
        settings,
        edge_metal=settings.edge_metal or strategy.edge_metal,
        ring_inset=settings.ring_inset or strategy.ring_inset,
        corner_radius=settings.corner_radius or strategy.corner_radius,
    )


def _metal(job: _Restoration, on: np.ndarray, after: np.ndarray) -> np.ndarray:
    """What idle moves of a layer pass over (m): its top or what was found; unknown cells count as the highest."""
    metal = np.where(on, np.fmax(after, job.found), np.fmax(job.found, job.standing))
    return np.where(np.isfinite(metal), metal, job.safe_z - job.settings.clearance)


def _warn(
    job: _Restoration,
    planned: list[PlannedLayer],
    complete: bool,
    nominal: HeightGrid,
    warnings: list[str],
) -> None:
    """Warns of what the plan cannot reach, with figures and places.

    A wall of the part hides what lies within WALL of it: there a shift of a cell is a step of the whole wall, and no
    metal. So the surface stands above nominal only where it stands above all that is wanted within that distance, and
    metal is missing only where it is missing from all that was found there.
    """
    settings, spec, missing = job.settings, nominal.spec, job.wanted - job.found
    cells = WALL / spec.resolution
    if not planned:
        warnings.append(
            f'nothing to restore: nowhere more than {settings.min_layer * settings.layer_height * 1e3:.2f} mm is '
            f'missing (largest depth {np.nanmax(missing) * 1e3:.2f} mm)'
        )
    above = masks.drop_spots(job.found - masks.highest_near(job.wanted, cells), SPOT, spec)
    least = settings.min_layer * settings.layer_height
    if above.max() > least:
        warnings.append(
            f'the surface stands up to {above.max() * 1e3:.2f} mm above nominal, {_where(above, least, spec)}; '
            'deposition cannot lower it, machine it first'
        )
    if complete and planned:
        laid = np.sum([p.planned for p in planned], axis=0)
        missing = job.wanted - masks.highest_near(job.found, cells) - laid
        short = masks.drop_spots(np.where(job.count > 0, missing, 0.0), SPOT, spec)
        if short.max() > 0.1 * settings.layer_height:
            warnings.append(
                f'the thickest layer limits the metal; {short.max() * 1e3:.2f} mm stay missing, '
                f'{_where(short, 0.1 * settings.layer_height, spec)}'
            )
    for layer in planned:
        want = metal_of(layer, spec, settings)
        if abs(layer.volume - want) > UNLIKE * want:
            warnings.append(
                f'layer {layer.number}: segments lay {layer.volume * 1e9:.0f} mm3 of {want * 1e9:.0f} mm3 planned '
                '(limits of layer height)'
            )


def _where(height: np.ndarray, limit: float, spec: GridSpec) -> str:
    """The island with the highest cell, of those above `limit`: its area, and the place of the cell."""
    row, col = np.unravel_index(int(np.argmax(height)), height.shape)
    labels = masks.label(height > limit)
    area = (labels == labels[row, col]).sum() * spec.resolution**2 * 1e6
    at = f'x = {spec.x[col] * 1e3:.1f} mm, y = {spec.y[row] * 1e3:.1f} mm'
    return f'on {area:.0f} mm2 around {at}'
