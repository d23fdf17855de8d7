"""The layers of a restoration, one after the other: where each lies, how thick it is, and which beads fill it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from waam_plan import finish, masks
from waam_plan.fill import strategies
from waam_plan.fill.linking import StartsBelow, arc_starts
from waam_plan.layers import sides
from waam_plan.layers.layer import LayerTask, lay
from waam_plan.layers.layout import best, most_even
from waam_plan.layers.schedule import Schedule, choose_schedule, layer_count
from waam_plan.plan import PlannedLayer, collector_paused, highest
from waam_plan.settings import PlanSettings
from waam_plan.shaft import around
from waam_plan.slice.section import outline
from waam_process.grid import GridSpec, HeightGrid


@dataclass(frozen=True)
class Restoration:
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
    ) -> Restoration:
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


def layers_of(
    job: Restoration, total: int, use: int, below: np.ndarray
) -> tuple[list[PlannedLayer], list[str]]:
    """`use` of `total` layers from the bottom, and the strategy that each is filled with. below: (n, 2) m, arc starts
    of the last layer laid."""
    planned: list[PlannedLayer] = []
    filled: list[str] = []
    starts = below
    with collector_paused():
        for number in range(1, use + 1):
            layer, strategy = _layer(job, number, total - number + 1, starts)
            planned.append(layer)
            filled.append(strategy)
            starts = arc_starts(layer.segments)
    return planned, filled


def _layer(job: Restoration, number: int, k: int, below: np.ndarray) -> tuple[PlannedLayer, str]:
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


def _free(job: Restoration, on: np.ndarray) -> np.ndarray:
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


def _metal(job: Restoration, on: np.ndarray, after: np.ndarray) -> np.ndarray:
    """What idle moves of a layer pass over (m): its top or what was found; unknown cells count as the highest."""
    metal = np.where(on, np.fmax(after, job.found), np.fmax(job.found, job.standing))
    return np.where(np.isfinite(metal), metal, job.safe_z - job.settings.clearance)
