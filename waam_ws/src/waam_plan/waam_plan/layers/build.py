"""Builds: a closed mesh on a flat substrate, horizontal layers from plane sections."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from waam_plan import masks
from waam_plan.fill import contour, strategies
from waam_plan.fill.linking import StartsBelow, arc_starts, near_starts
from waam_plan.layers import shapes, sides
from waam_plan.layers.coverage import Point3, Section, check_overhang, cut_sections
from waam_plan.layers.layer import LayerTask, lay
from waam_plan.layers.schedule import finishing_layers
from waam_plan.layers.travel import Ceiling, relaid
from waam_plan.mesh.part import Part, PartError, check_fits
from waam_plan.plan import Plan, PlanError, PlannedLayer, check_reach, collector_paused
from waam_plan.settings import JUDGED_RIM, PlanSettings
from waam_plan.slice.levels import Level, adaptive_levels, equal_levels
from waam_plan.slice.section import raster
from waam_process.grid import GridSpec, HeightGrid

MAP_BUDGET = 24_000_000  # cells times layers that a plan may hold; larger parts get a coarser grid

SAME_SECTION = 1e-6  # m, by which sections may differ and still be filled once


def plan_build(
    part: Part,
    settings: PlanSettings,
    layers: int = 0,
    spec: GridSpec | None = None,
) -> Plan:
    """Plan a mesh on a flat substrate at z = 0 of the work frame.

    The part's lower corner is put to the work zero; where it leaves the machine there, its middle into the middle
    of the machine (Plan.offset says how far it was moved).
    layers: greatest number of layers, from the bottom; 0 = all. spec: grid of the maps, default around the part.
    settings.strategy 'shell' lays one bead along the surface and accepts open meshes whose sections are closed.
    Raises PartError or PlanError with everything that is wrong: open mesh, too large, overhang, walls too thin,
    sections that vanish.
    """
    if layers < 0:
        raise PlanError(f'layers is {layers}, must be 0 (all) or a positive number')
    if settings.finish != PlanSettings.finish:
        raise PlanError(f'finish {settings.finish}: only a restoration knows this')
    _check_mesh(part, settings)
    warnings: list[str] = []
    remarks: list[str] = []
    if settings.shrinkage:
        part = shapes.grown(part, settings.shrinkage)
        remarks.append(
            f'scaled by {1 / (1 - settings.shrinkage):.4f} against a shrinkage of {settings.shrinkage:.2%}'
        )
    offset = _placing(part, spec, settings, warnings)
    placed = part.moved(offset)
    if settings.compensation_height > 0:
        offset = (*offset[:2], offset[2] + settings.compensation_height)
    sections = _checked_sections(part, placed, layers, offset, settings, warnings, remarks)
    safe_z = sections[-1].z + sections[-1].thickness + settings.clearance
    spec = spec or _grid(placed, len(sections), settings, warnings)
    with collector_paused():
        planned = _layers(sections, spec, safe_z, settings)
    warnings += near_starts([arc_starts(p.segments) for p in planned], settings.start_spread)
    plan = _assemble(part, planned, spec, safe_z, settings, offset, warnings, remarks)
    check_reach([s for layer in planned for s in layer.segments], settings)
    return plan


def _checked_sections(
    part: Part,
    placed: Part,
    layers: int,
    offset: Point3,
    settings: PlanSettings,
    warnings: list[str],
    remarks: list[str],
) -> list[Section]:
    """Sections of the layers. Raises with all that is wrong with size, sections, height and overhang."""
    levels, base = _levels(placed, settings), shapes.compensation_layers(settings)
    needed = len(levels) + base
    if layers > needed:
        warnings.append(f'{layers} layers were asked for, {needed} are needed')
    use = min(max(layers - base, 1), len(levels)) if layers else len(levels)
    wrong: list[ValueError] = []
    with _kept(wrong):
        check_fits(part, settings)
    sections: list[Section] = []
    with _kept(wrong):
        sections = cut_sections(placed, levels, use, settings, warnings)
        sections = shapes.on_compensation(sections, settings, remarks)[: layers or None]
    if sections:
        top = sections[-1].z + sections[-1].thickness
        with _kept(wrong):
            _check_height(part, top + settings.clearance, sections[0].thickness, settings)
        with _kept(wrong):
            check_overhang(sections, settings, part, offset, warnings)
    if wrong:
        raise type(wrong[0])('; '.join(map(str, wrong)))
    return sections


@contextmanager
def _kept(wrong: list[ValueError]) -> Iterator[None]:
    """Collects a refusal with the others instead of ending the checks."""
    try:
        yield
    except (PartError, PlanError) as error:
        wrong.append(error)


def _levels(placed: Part, settings: PlanSettings) -> list[Level]:
    if settings.levels == 'adaptive':
        return adaptive_levels(np.asarray(placed.mesh.triangles), settings)
    height, tops = float(placed.bounds[1, 2]), finishing_layers(settings)
    below = height - sum(tops)
    if not tops or below < settings.layer_height:
        return equal_levels(height, settings)
    levels = equal_levels(below, settings)
    for thickness in reversed(tops):
        levels.append(Level(below, thickness))
        below += thickness
    return levels


def _check_mesh(part: Part, settings: PlanSettings) -> None:
    if not part.report.closed and settings.strategy != 'shell':
        raise PartError(
            f'{part.path}: open mesh with {part.report.boundary_edges} boundary edges cannot be built as a solid; '
            "close it, or choose strategy 'shell' to build its surface as a wall of one bead"
        )


def _placing(
    part: Part, spec: GridSpec | None, settings: PlanSettings, warnings: list[str]
) -> Point3:
    """Offset (m) that puts the part's lower corner at the work zero, or its middle into that of the machine."""
    low, high = part.bounds
    size = high - low
    if spec is not None:
        x0, x1, y0, y1 = spec.extent
        if min(-x0, -y0, x1 - size[0], y1 - size[1]) < -1e-9:
            raise PlanError(
                f'{part.path}: {size[0] * 1e3:.1f} x {size[1] * 1e3:.1f} mm from the work zero leave the grid '
                f'x {x0 * 1e3:.1f}..{x1 * 1e3:.1f}, y {y0 * 1e3:.1f}..{y1 * 1e3:.1f} mm'
            )
    offset = -low
    reach_low, reach_high = np.array(settings.machine_min), np.array(settings.machine_max)
    outside = (reach_low[:2] > 0).any() or (size[:2] > reach_high[:2]).any()
    if outside and spec is None:
        offset[:2] = ((reach_low + reach_high - low - high) / 2)[:2]
        warnings.append(
            'with its lower corner at the work zero the part leaves the machine; its lower corner is put to '
            f'({(low + offset)[0] * 1e3:.1f}, {(low + offset)[1] * 1e3:.1f}) mm'
        )
    x, y, z = offset
    return float(x), float(y), float(z)


def _check_height(part: Part, safe_z: float, thickness: float, settings: PlanSettings) -> None:
    if safe_z > settings.machine_max[2] + 1e-9:
        most = int((settings.machine_max[2] - settings.clearance) / thickness + 1e-6)
        raise PlanError(
            f'{part.path}: outside the machine: {safe_z * 1e3:.1f} mm with clearance, z reaches '
            f'{settings.machine_max[2] * 1e3:.1f} mm above the substrate; plan at most {most} layers or scale the part'
        )


def _grid(placed: Part, use: int, settings: PlanSettings, warnings: list[str]) -> GridSpec:
    """Grid around the part with two beads of margin; coarser than settings.grid where maps would get too large."""
    (x0, y0, _), (x1, y1, _) = placed.bounds
    margin = 2 * settings.bead_width
    cells = (x1 - x0 + 2 * margin) * (y1 - y0 + 2 * margin) / settings.grid**2
    coarser = max(1, math.ceil(math.sqrt(cells * use / MAP_BUDGET)))
    if coarser > 1:
        warnings.append(
            f'{use} layers of this size: maps with cells of {settings.grid * coarser * 1e3:.2f} mm'
        )
    res = settings.grid * coarser
    x_min, y_min = (math.floor((v - margin) / res) * res for v in (x0, y0))
    return GridSpec.covering(x_min, y_min, x1 + margin, y1 + margin, res)


def _layers(
    sections: list[Section],
    spec: GridSpec,
    safe_z: float,
    settings: PlanSettings,
) -> list[PlannedLayer]:
    """Layers from the bottom. One with the section of the layer two below repeats its path."""
    out: list[PlannedLayer] = []
    references: dict[
        int, tuple[Section, PlannedLayer]
    ] = {}  # by parity: directions and starts alternate
    metal = np.zeros(spec.shape)
    supported = np.ones(spec.shape, bool)
    starts = np.zeros((0, 2))
    for section in sections:
        known = references.get(section.number % 2)
        if known and _same(known[0], section, settings):
            metal[known[1].footprint] = section.z + section.thickness
            layer = _repeated(known[1], section, supported, metal, spec, safe_z, settings)
        else:
            on = raster(section.polygons, spec)
            metal[on] = section.z + section.thickness
            layer = _layer(section, on, supported, metal, starts, spec, safe_z, settings)
            references[section.number % 2] = (section, layer)
        out.append(layer)
        supported = layer.footprint
        starts = arc_starts(layer.segments)
    return out


def _same(a: Section, b: Section, settings: PlanSettings) -> bool:
    """Whether two sections differ by at most SAME_SECTION and are filled alike.

    Layers with closed lines (whose seam moves), as around a hole, and a turning angle never repeat.
    """
    if settings.alternation == 'turn' or settings.strategy not in ('solid', 'zigzag', 'shell'):
        return False
    if len(a.polygons) != len(b.polygons) or abs(a.thickness - b.thickness) > 1e-9:
        return False
    if (a.number <= settings.base_layers) != (b.number <= settings.base_layers):
        return False
    if any(len(p.interiors) == 1 or contour.is_wall(p, settings) for p in b.polygons):
        return False
    pairs = zip(a.polygons, b.polygons, strict=True)
    return all(p.boundary.hausdorff_distance(q.boundary) <= SAME_SECTION for p, q in pairs)


def _repeated(
    layer: PlannedLayer,
    section: Section,
    supported: np.ndarray,
    metal: np.ndarray,
    spec: GridSpec,
    safe_z: float,
    settings: PlanSettings,
) -> PlannedLayer:
    """The path of a layer at another height."""
    ceiling = Ceiling.over(spec, metal, settings.torch_radius)
    segments = relaid(layer.segments, section.z, section.number, ceiling, safe_z, settings)
    planned, before, after = _surfaces(section, layer.footprint, supported)
    return PlannedLayer(
        number=section.number,
        planned=planned,
        target_before=before,
        target_after=after,
        segments=segments,
        direction=layer.direction,
        footprint=layer.footprint,
        beside=layer.beside,
    )


def _layer(
    section: Section,
    on: np.ndarray,
    supported: np.ndarray,
    metal: np.ndarray,
    starts: np.ndarray,
    spec: GridSpec,
    safe_z: float,
    settings: PlanSettings,
) -> PlannedLayer:
    """One layer: filled by the strategy, metal shared out cell by cell."""
    cover = sides.of_section(section.polygons, on, spec, settings)
    within = sides.settings_within(settings)
    below = StartsBelow(starts, settings.start_spread)
    area = strategies.Area(cover.polygons, cover.mask, spec, within, section.number, below=below)
    chains = strategies.fill(area)
    if not chains or not on.any():
        raise PlanError(
            f'layer {section.number} at z = {section.z * 1e3:.1f} mm has no room for a bead'
        )
    planned, before, after = _surfaces(section, on, supported)
    task = LayerTask(
        number=section.number,
        turn=section.number,
        footprint=on,
        cover=cover.metal,
        planned=planned,
        before=before,
        after=after,
        ground=np.full(spec.shape, section.z),
        metal=metal,
        inside=section.polygons,
        slower=settings.base_speed if section.number <= settings.base_layers else 1.0,
    )
    return lay(task, chains, starts, spec=spec, safe_z=safe_z, settings=settings)


def _surfaces(
    section: Section, on: np.ndarray, supported: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Metal of the layer and the surfaces wanted before and after it, (rows, cols) m."""
    before = np.where(on & supported, section.z, np.nan)
    after = np.where(on, section.z + section.thickness, np.nan)
    return np.where(on, section.thickness, 0.0), before, after


def _assemble(
    part: Part,
    planned: list[PlannedLayer],
    spec: GridSpec,
    safe_z: float,
    settings: PlanSettings,
    offset: Point3,
    warnings: list[str],
    remarks: list[str],
) -> Plan:
    region = np.any([p.footprint for p in planned], axis=0)
    top, res = np.full(spec.shape, np.nan), spec.resolution
    for layer in planned:
        np.copyto(top, layer.target_after, where=layer.footprint)
    return Plan(
        spec,
        HeightGrid.full(spec, 0.0),
        HeightGrid(spec, top),
        region,
        masks.judged(region, JUDGED_RIM / res, settings.bead_width / res),
        planned,
        safe_z,
        settings,
        mode='build',
        name=part.name,
        offset=offset,
        warnings=warnings,
        remarks=remarks,
    )
