"""What each layer of a build covers: cut, widened below overhangs, checked for thin places and overhang."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from shapely import Point, Polygon

from waam_plan.fill import contour
from waam_plan.mesh.part import Part
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_plan.slice.levels import Level
from waam_plan.slice.section import merged, pieces, section_polygons
from waam_process.bead import AREA_FACTOR

THINNEST = 0.6  # of a bead: no wall thinner than this can be built
TIP = 1.5  # bead widths of height that a part may lose where its tip is thinner than a bead
# bead widths squared: smaller pieces beyond the limit are carried by their neighbours
SMALLEST_OVERHANG = 0.25
SPECK = 2.0  # bead widths squared: a too thin piece smaller than this is left out with a warning

Point3 = tuple[float, float, float]


@dataclass(frozen=True)
class Section:
    """What one layer covers: polygons in work coordinates, between z and z + thickness (m)."""

    number: int
    z: float
    thickness: float
    polygons: list[Polygon]


def cut_sections(
    placed: Part, levels: list[Level], use: int, settings: PlanSettings, warnings: list[str]
) -> list[Section]:
    """The lowest `use` of the layers, fewer where the tip of the part is too thin for a bead."""
    shapes = _with_foot(placed, levels, use, settings, warnings)
    height = levels[-1].top
    out: list[Section] = []
    for i, (level, shape) in enumerate(zip(levels[:use], shapes, strict=False)):
        kept = _buildable(shape, i + 1, level.z, settings, placed, warnings)
        if not kept and out and height - level.z <= TIP * settings.bead_width:
            warnings.append(
                f'the top {(height - level.z) * 1e3:.1f} mm are thinner than a bead and left out; '
                f'{i} of {len(levels)} layers planned'
            )
            break
        if not kept:
            _refuse_thin(shape, i + 1, level.z, settings, placed)
        out.append(Section(i + 1, level.z, level.thickness, kept))
    return out


def _with_foot(
    placed: Part, levels: list[Level], use: int, settings: PlanSettings, warnings: list[str]
) -> list[list[Polygon]]:
    """Sections of the lowest layers, filled from below where they overhang close to the substrate."""
    thickness = levels[0].thickness
    foot = min(len(levels), round(settings.foot_height / thickness))
    cut = [_cut(placed, i, level, settings) for i, level in enumerate(levels[: max(use, foot)])]
    added = _add_foot(cut[:foot], levels, settings)
    extra = sum(
        (merged(new).area - merged(old).area) * level.thickness
        for new, old, level in zip(added, cut, levels, strict=False)
    )
    if extra > 1e-9:
        warnings.append(
            f'foot: {extra * 1e6:.2f} cm3 of metal added below overhangs in the lowest '
            f'{levels[foot - 1].top * 1e3:.1f} mm, to be machined off'
        )
    return [*added, *cut[foot:]][:use]


def _cut(placed: Part, i: int, level: Level, settings: PlanSettings) -> list[Polygon]:
    """Section in the middle of layer i (from 0); in a shell the wall of one bead along it."""
    z = level.z + level.thickness / 2
    found = section_polygons(np.asarray(placed.mesh.vertices), np.asarray(placed.mesh.faces), z)
    if not found:
        raise PlanError(
            f'{placed.path}: the section {z * 1e3:.2f} mm above the bottom (layer {i + 1}) has no closed outline; '
            'the mesh has a hole or a gap there, repair it'
        )
    if settings.strategy == 'shell':
        wall = AREA_FACTOR * settings.bead_width / 2  # one bead of the layer's height fills it
        return pieces(merged([p.boundary.buffer(wall) for p in found]))
    return found


def _add_foot(
    shapes: list[list[Polygon]], levels: list[Level], settings: PlanSettings
) -> list[list[Polygon]]:
    """Lower sections widened until nothing in them overhangs further than the limit."""
    slope = math.tan(math.radians(settings.overhang_limit_deg))
    out = list(shapes)
    for i in range(len(out) - 2, -1, -1):
        step = levels[i + 1].thickness * slope
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


def check_overhang(
    sections: list[Section],
    settings: PlanSettings,
    part: Part,
    offset: Point3,
    warnings: list[str],
) -> None:
    """Refuses the first layer with a piece that juts out further than the limit; overhang 'flag' only warns."""
    for below, above in zip(sections, sections[1:], strict=False):
        text = _overhang(below, above, settings, offset)
        if not text:
            continue
        if settings.overhang == 'refuse':
            raise PlanError(
                f'{part.path}: {text}; turn the part, widen what is below, allow more (overhang_limit_deg, '
                f"foot_height, overhang 'flag'), tilt it (--machine robot --tilt) or plan at most {below.number} layers"
            )
        warnings.append(text)


def _overhang(below: Section, above: Section, settings: PlanSettings, offset: Point3) -> str:
    """Angle, place and area of what juts out too far; empty where nothing does."""
    step = above.thickness * math.tan(math.radians(settings.overhang_limit_deg))
    base, top = merged(below.polygons), merged(above.polygons)
    least = SMALLEST_OVERHANG * settings.bead_width**2
    loose = [p for p in pieces(top.difference(base.buffer(step))) if p.area > least]
    if not loose:
        return ''
    area = sum(p.area for p in loose)
    worst = max(loose, key=lambda p: p.area)
    reach = max(base.distance(Point(c[:2])) for p in loose for c in p.exterior.coords)
    angle = math.degrees(math.atan2(reach, above.thickness))
    at = worst.representative_point()
    return (
        f'overhang of {angle:.0f} deg (limit {settings.overhang_limit_deg:.0f} deg) in layer '
        f'{above.number} at part coordinates ({(at.x - offset[0]) * 1e3:.1f}, {(at.y - offset[1]) * 1e3:.1f}, '
        f'{(above.z - offset[2]) * 1e3:.1f}) mm: {area * 1e6:.0f} mm2 = {area / top.area:.1%} of the layer has no '
        'metal below'
    )
