"""Rules of source 003 for what a build covers: compensation layer, stiffeners, teardrop holes. All off by default.

They act on the sections of the layers, after these were cut and before overhangs are checked.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from waam_plan.fill import contour
from waam_plan.lay.coverage import SMALLEST_OVERHANG, Section
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import merged, pieces

WITHIN = 0.9  # share of a loose piece in a gap, and of a gap under a layer above


def base_layers(settings: PlanSettings) -> int:
    """Layers of the compensation layer."""
    if settings.compensation_height <= 0:
        return 0
    return max(1, round(settings.compensation_height / settings.layer_height))


def shaped(sections: list[Section], settings: PlanSettings, remarks: list[str]) -> list[Section]:
    """The sections by all rules that are on; remarks: for a person."""
    if settings.stiffener_spacing > 0:
        sections = stiffened(sections, settings, remarks)
    if settings.teardrop:
        sections = with_teardrops(sections, settings, remarks)
    if settings.compensation_height > 0:
        sections = on_compensation(sections, settings, remarks)
    return sections


def on_compensation(
    sections: list[Section], settings: PlanSettings, remarks: list[str]
) -> list[Section]:
    """The part on layers of its own lowest section, which settle the process and the mixture with the substrate.

    S3 section 4.2: 10 to 15 mm, to be cut off.
    """
    count, height = base_layers(settings), settings.compensation_height
    lowest = sections[0].polygons
    area = merged(lowest).area
    remarks.append(
        f'compensation layer: {height * 1e3:.1f} mm in {count} layers below the part, '
        f'{area * height * 1e6:.1f} cm3, to be cut off'
    )
    below = [Section(i + 1, i * height / count, height / count, lowest) for i in range(count)]
    above = [replace(s, number=s.number + count, z=s.z + height) for s in sections]
    return [*below, *above]


# ---- teardrop holes ------------------------------------------------------------------------------


def with_teardrops(
    sections: list[Section], settings: PlanSettings, remarks: list[str]
) -> list[Section]:
    """Holes that lie on their side end in a point: of their roof is left out what the layer below does not carry.

    S3 table 4.1; the roof leans by overhang_limit_deg. What juts out without being the roof of a hole stays as it is.
    """
    slope = math.tan(math.radians(settings.overhang_limit_deg))
    least = SMALLEST_OVERHANG * settings.bead_width**2
    out = sections[:1]
    left, tops = 0.0, []
    for n, section in enumerate(sections[1:], 1):
        below, shape = merged(out[-1].polygons), merged(section.polygons)
        loose = pieces(shape.difference(below.buffer(section.thickness * slope)))
        large = [p for p in loose if p.area > least]
        roofs = _roofs(large, below, sections[n:]) if large else []
        if roofs:
            left += sum(p.area for p in roofs) * section.thickness
            tops.append(section.z + section.thickness)
            kept = pieces(shape.difference(merged(roofs)))
            section = replace(section, polygons=sorted(kept, key=lambda p: -p.area))
        out.append(section)
    if tops:
        remarks.append(
            f'teardrop holes: {left * 1e6:.2f} cm3 of roofs left out between z = {min(tops) * 1e3:.1f} and '
            f'{max(tops) * 1e3:.1f} mm'
        )
    return out


def _roofs(loose: list[Polygon], below: BaseGeometry, above: list[Section]) -> list[Polygon]:
    """Loose pieces over gaps of the layer below that a layer above covers."""
    gaps = pieces(below.convex_hull.difference(below))
    return [
        p
        for p in loose
        if any(g.intersection(p).area > WITHIN * p.area and _covered(g, above) for g in gaps)
    ]


def _covered(gap: Polygon, above: list[Section]) -> bool:
    return any(gap.difference(merged(s.polygons)).area < (1 - WITHIN) * gap.area for s in above)


# ---- stiffeners ----------------------------------------------------------------------------------


def stiffened(sections: list[Section], settings: PlanSettings, remarks: list[str]) -> list[Section]:
    """Ribs across thin walls, one bead thick, against their warping (S3 section 4.1); to be machined off.

    They stand at even distances along the outside of the walls of the lowest layer, the same in all layers.
    """
    walls = [p for p in sections[0].polygons if contour.is_wall(p, settings)]
    ribs = [rib for wall in walls for rib in _ribs(wall, settings)]
    if not ribs:
        remarks.append('no stiffeners: the lowest layer has no wall of one or two beads')
        return sections
    out = []
    for section in sections:
        shape = merged(section.polygons)
        standing = [r for r in ribs if r.intersects(shape)]
        both = pieces(merged([*section.polygons, *standing]))
        out.append(replace(section, polygons=sorted(both, key=lambda p: -p.area)))
    extra = sum(
        (merged(a.polygons).area - merged(b.polygons).area) * a.thickness
        for a, b in zip(out, sections, strict=True)
    )
    remarks.append(f'{len(ribs)} stiffeners: {extra * 1e6:.2f} cm3, to be machined off')
    return out


def _ribs(wall: Polygon, settings: PlanSettings) -> list[Polygon]:
    ring = wall.exterior
    count = max(1, round(ring.length / settings.stiffener_spacing))
    sense = 1.0 if ring.is_ccw else -1.0
    inward = contour.wall_width(wall) / 2
    ribs = []
    for k in range(count):
        s = (k + 0.5) * ring.length / count
        a, b = (np.array(ring.interpolate((s + d) % ring.length).coords[0]) for d in (-1e-4, 1e-4))
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-12)
        out = sense * np.array([along[1], -along[0]])
        foot = (a + b) / 2 - inward * out
        line = LineString([foot, foot + (inward + settings.stiffener_length) * out])
        ribs.append(line.buffer(settings.bead_width / 2, cap_style='flat'))
    return ribs
