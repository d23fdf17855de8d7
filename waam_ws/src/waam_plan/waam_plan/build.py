"""Builds: a closed mesh on a flat substrate, horizontal layers from plane sections."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from shapely import Point, Polygon

from waam_plan import contour, hatch, masks, path
from waam_plan.allocate import metal_heights
from waam_plan.part import Part, PartError, check_fits
from waam_plan.plan import Plan, PlanError, PlannedLayer, check_reach
from waam_plan.section import merged, pieces, raster, section_polygons
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid

MAP_BUDGET = 8_000_000  # cells times layers that a plan may hold; larger parts get a coarser grid
THINNEST = 0.6  # of a bead: no wall thinner than this can be built
TIP = 1.5  # bead widths: a part may lose so much of its height where its tip is thinner than a bead
SMALLEST_OVERHANG = (
    0.25  # bead widths squared: smaller pieces beyond the limit are carried by their neighbours
)
SPECK = 2.0  # bead widths squared: a too thin piece smaller than this is left out with a warning


Point3 = tuple[float, float, float]


@dataclass(frozen=True)
class Section:
    """What one layer covers: polygons in work coordinates, between z and z + thickness (m)."""

    number: int
    z: float
    thickness: float
    polygons: list[Polygon]


def plan_build(
    part: Part, settings: PlanSettings, layers: int = 0, spec: GridSpec | None = None
) -> Plan:
    """Plan a mesh on a flat substrate at z = 0 of the work frame.

    The part's lower corner is put to the work zero; where it leaves the machine there, its middle into the middle
    of the machine (Plan.offset says how far it was moved).
    layers: at most so many from the bottom, 0 = all. spec: grid of the maps, default around the part.
    settings.strategy 'shell' lays one bead along the surface and accepts open meshes whose sections are closed.
    Raises PartError or PlanError: open mesh, too large, overhang, walls too thin, sections that vanish.
    """
    if layers < 0:
        raise PlanError(f'layers is {layers}, must be 0 (all) or a positive number')
    _check_mesh(part, settings)
    check_fits(part, settings)
    warnings: list[str] = []
    offset = _placing(part, spec, settings, warnings)
    placed = part.moved(offset)
    height = float(placed.bounds[1, 2])
    total = max(1, round(height / settings.layer_height))
    if layers > total:
        warnings.append(f'{layers} layers were asked for, {total} are needed')
    use = min(layers, total) if layers else total
    sections = _sections(placed, total, use, height / total, settings, warnings)
    safe_z = sections[-1].z + sections[-1].thickness + settings.clearance
    _check_height(part, safe_z, sections[0].thickness, settings)
    _check_overhang(sections, settings, part, offset)
    spec = spec or _grid(placed, len(sections), settings, warnings)
    planned = _layers(sections, spec, safe_z, settings)
    plan = _assemble(part, planned, spec, safe_z, settings, offset, warnings)
    check_reach([s for layer in planned for s in layer.segments], settings)
    return plan


def _check_mesh(part: Part, settings: PlanSettings) -> None:
    if not part.report.closed and settings.strategy == 'solid':
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
    return tuple(float(v) for v in offset)


def _check_height(part: Part, safe_z: float, thickness: float, settings: PlanSettings) -> None:
    if safe_z > settings.machine_max[2] + 1e-9:
        most = int((settings.machine_max[2] - settings.clearance) / thickness + 1e-6)
        raise PlanError(
            f'{part.path}: outside the machine: {safe_z * 1e3:.1f} mm with clearance, z reaches '
            f'{settings.machine_max[2] * 1e3:.1f} mm above the substrate; plan at most {most} layers or scale the part'
        )


def _sections(
    placed: Part,
    total: int,
    use: int,
    thickness: float,
    settings: PlanSettings,
    warnings: list[str],
) -> list[Section]:
    """The lowest `use` of `total` layers, fewer where the tip of the part is too thin for a bead."""
    foot = min(total, round(settings.foot_height / thickness))
    shapes = [_cut(placed, i, thickness, settings) for i in range(max(use, foot))]
    added = _add_foot(shapes[:foot], thickness, settings)
    shapes[:foot] = added
    extra = sum(
        merged(s).area - merged(_cut(placed, i, thickness, settings)).area
        for i, s in enumerate(added)
    )
    if extra * thickness > 1e-9:
        warnings.append(
            f'foot: {extra * thickness * 1e6:.2f} cm3 of metal added below overhangs in the lowest '
            f'{foot * thickness * 1e3:.1f} mm, to be machined off'
        )
    out: list[Section] = []
    for i, shape in enumerate(shapes[:use]):
        kept = _buildable(shape, i + 1, i * thickness, settings, placed, warnings)
        if not kept and out and (total - i) * thickness <= TIP * settings.bead_width:
            warnings.append(
                f'the top {(total - i) * thickness * 1e3:.1f} mm are thinner than a bead and left out; '
                f'{i} of {total} layers planned'
            )
            break
        if not kept:
            _refuse_thin(shape, i + 1, i * thickness, settings, placed)
        out.append(Section(i + 1, i * thickness, thickness, kept))
    return out


def _cut(placed: Part, i: int, thickness: float, settings: PlanSettings) -> list[Polygon]:
    """Section in the middle of layer i (from 0); in a shell the wall of one bead along it."""
    z = (i + 0.5) * thickness
    found = section_polygons(np.asarray(placed.mesh.vertices), np.asarray(placed.mesh.faces), z)
    if not found:
        raise PlanError(
            f'{placed.path}: the section {z * 1e3:.2f} mm above the bottom (layer {i + 1}) has no closed outline; '
            'the mesh has a hole or a gap there, repair it'
        )
    if settings.strategy == 'shell':
        return pieces(merged([p.boundary.buffer(settings.pitch / 2) for p in found]))
    return found


def _add_foot(
    shapes: list[list[Polygon]], thickness: float, settings: PlanSettings
) -> list[list[Polygon]]:
    """Lower sections widened until nothing in them overhangs further than the limit."""
    step = thickness * math.tan(math.radians(settings.overhang_limit_deg))
    out = list(shapes)
    for i in range(len(out) - 2, -1, -1):
        above, own = merged(out[i + 1]), merged(out[i])
        if above.difference(own.buffer(step)).area > 1e-9:
            out[i] = pieces(own.union(above.buffer(-step)))
    return out


def _buildable(
    polygons: list[Polygon],
    number: int,
    z: float,
    settings: PlanSettings,
    part: Part,
    warnings: list[str],
) -> list[Polygon]:
    """Polygons wide enough for a bead; specks beside them are left out, larger thin features refused."""
    thin = [p for p in polygons if p.buffer(-0.5 * THINNEST * settings.bead_width).is_empty]
    if len(thin) == len(polygons):
        return []
    if any(p.area > SPECK * settings.bead_width**2 for p in thin):
        _refuse_thin(thin, number, z, settings, part)
    if sum(p.area for p in thin) > 0.1 * settings.bead_width**2:
        warnings.append(
            f'{len(thin)} pieces of together {sum(p.area for p in thin) * 1e6:.1f} mm2 in layer {number} '
            f'(z = {z * 1e3:.1f} mm), one at {_xy(thin[0])}, are too small for a bead and left out'
        )
    return [p for p in polygons if not any(p is t for t in thin)]


def _refuse_thin(
    thin: list[Polygon], number: int, z: float, settings: PlanSettings, part: Part
) -> None:
    widest = max(thin, key=lambda p: p.area)
    raise PlanError(
        f'{part.path}: layer {number} at z = {z * 1e3:.1f} mm: {len(thin)} features about '
        f'{contour.wall_width(widest) * 1e3:.1f} mm thick, one at {_xy(widest)}, are too thin for a bead of '
        f'{settings.bead_width * 1e3:.1f} mm (thinnest {THINNEST * settings.bead_width * 1e3:.1f} mm); use thinner '
        f'beads, thicken or scale the part, or plan at most {number - 1} layers'
    )


def _xy(polygon: Polygon) -> str:
    at = polygon.representative_point()
    return f'x = {at.x * 1e3:.1f} mm, y = {at.y * 1e3:.1f} mm'


def _check_overhang(
    sections: list[Section], settings: PlanSettings, part: Part, offset: Point3
) -> None:
    """Refuses the first layer with a piece that juts out further than the limit allows."""
    for below, above in zip(sections, sections[1:], strict=False):
        step = above.thickness * math.tan(math.radians(settings.overhang_limit_deg))
        base, top = merged(below.polygons), merged(above.polygons)
        least = SMALLEST_OVERHANG * settings.bead_width**2
        loose = [p for p in pieces(top.difference(base.buffer(step))) if p.area > least]
        if not loose:
            continue
        area = sum(p.area for p in loose)
        worst = max(loose, key=lambda p: p.area)
        reach = max(base.distance(Point(c[:2])) for p in loose for c in p.exterior.coords)
        angle = math.degrees(math.atan2(reach, above.thickness))
        at = worst.representative_point()
        raise PlanError(
            f'{part.path}: overhang of {angle:.0f} deg (limit {settings.overhang_limit_deg:.0f} deg) in layer '
            f'{above.number} at part coordinates ({(at.x - offset[0]) * 1e3:.1f}, {(at.y - offset[1]) * 1e3:.1f}, '
            f'{(above.z - offset[2]) * 1e3:.1f}) mm: {area * 1e6:.0f} mm2 = {area / top.area:.1%} of the layer has no '
            f'metal below; turn the part, widen what is below, allow more (overhang_limit_deg, foot_height) or plan '
            f'at most {below.number} layers'
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
    snap = [math.floor((v - margin) / res) * res for v in (x0, y0)]
    return GridSpec.covering(*snap, x1 + margin, y1 + margin, res)


def _layers(
    sections: list[Section], spec: GridSpec, safe_z: float, settings: PlanSettings
) -> list[PlannedLayer]:
    """Layers from the bottom. One with the section of the layer two below (growth_step) repeats its path."""
    out: list[PlannedLayer] = []
    references: dict[
        int, tuple[Section, PlannedLayer]
    ] = {}  # by parity: directions and starts alternate
    supported = np.ones(spec.shape, bool)
    for section in sections:
        known = references.get(section.number % 2)
        if known and _same(known[0], section, settings):
            layer = _repeated(known[1], section, supported)
        else:
            layer = _layer(section, supported, spec, safe_z, settings)
            references[section.number % 2] = (section, layer)
        out.append(layer)
        supported = layer.footprint
    return out


def _same(a: Section, b: Section, settings: PlanSettings) -> bool:
    """Whether two sections differ by at most growth_step. Walls move their seam and never repeat."""
    if len(a.polygons) != len(b.polygons) or abs(a.thickness - b.thickness) > 1e-9:
        return False
    if any(contour.is_wall(p, settings) for p in b.polygons):
        return False
    pairs = zip(a.polygons, b.polygons, strict=True)
    return all(p.boundary.hausdorff_distance(q.boundary) <= settings.growth_step for p, q in pairs)


def _repeated(layer: PlannedLayer, section: Section, supported: np.ndarray) -> PlannedLayer:
    on = layer.footprint
    low = layer.deposits[0].start[2]

    def moved(p: Point3) -> Point3:
        return (p[0], p[1], section.z if abs(p[2] - low) < 1e-6 else p[2])

    segments = [
        s.at(start=moved(s.start), end=moved(s.end), layer=section.number) for s in layer.segments
    ]
    before = np.where(on & supported, section.z, np.nan)
    after = np.where(on, section.z + section.thickness, np.nan)
    return PlannedLayer(section.number, layer.planned, before, after, segments, layer.direction, on)


def _layer(
    section: Section, supported: np.ndarray, spec: GridSpec, safe_z: float, settings: PlanSettings
) -> PlannedLayer:
    """One layer: thin walls by contour, the rest by hatch; metal shared out cell by cell."""
    walls = [p for p in section.polygons if contour.is_wall(p, settings)]
    solids = [p for p in section.polygons if not contour.is_wall(p, settings)]
    on = raster(section.polygons, spec)
    chains: list[hatch.Chain] = [
        [line] for p in walls for line in contour.wall_lines(p, settings, section.number)
    ]
    solid = raster(solids, spec)
    direction = path.choose_direction(on, settings, section.number)
    if solid.any():
        filled, direction = path.hatch_region(solid, spec, settings, section.number)
        chains = filled + chains
    if not chains or not on.any():
        raise PlanError(
            f'layer {section.number} at z = {section.z * 1e3:.1f} mm has no room for a bead'
        )
    pieces_ = path.lay_out(chains, HeightGrid.full(spec, section.z), settings)
    planned = np.where(on, section.thickness, 0.0)
    height = metal_heights(pieces_, planned, on, spec, settings)
    segments = path.to_segments(pieces_, height, section.number, safe_z, settings)
    before = np.where(on & supported, section.z, np.nan)
    after = np.where(on, section.z + section.thickness, np.nan)
    vector = (1.0, 0.0, 0.0) if direction == 'x' else (0.0, 1.0, 0.0)
    return PlannedLayer(section.number, planned, before, after, segments, vector, on)


def _assemble(
    part: Part,
    planned: list[PlannedLayer],
    spec: GridSpec,
    safe_z: float,
    settings: PlanSettings,
    offset: Point3,
    warnings: list[str],
) -> Plan:
    region = np.any([p.footprint for p in planned], axis=0)
    top = np.full(spec.shape, np.nan)
    for layer in planned:
        np.copyto(top, layer.target_after, where=layer.footprint)
    return Plan(
        spec,
        HeightGrid.full(spec, 0.0),
        HeightGrid(spec, top),
        region,
        masks.shrink(region, settings.bead_width / 2 / spec.resolution),
        planned,
        safe_z,
        settings,
        mode='build',
        name=part.name,
        offset=offset,
        warnings=warnings,
    )
