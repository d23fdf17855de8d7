"""Rules of source 003 for what a build covers, off by default: larger by what it shrinks, on a compensation layer."""

from __future__ import annotations

from dataclasses import replace

from waam_plan.layers.coverage import Section
from waam_plan.mesh.part import Part
from waam_plan.settings import PlanSettings
from waam_plan.slice.section import merged


def grown(part: Part, shrinkage: float) -> Part:
    """Larger by 1 / (1 - shrinkage) about its lower corner: what is laid shrinks by this share (S3 section 4.1)."""
    mesh = part.mesh.copy()
    low = part.bounds[0]
    mesh.apply_translation(-low)
    mesh.apply_scale(1 / (1 - shrinkage))
    mesh.apply_translation(low)
    return replace(part, mesh=mesh)


def compensation_layers(settings: PlanSettings) -> int:
    """Layers of the compensation layer."""
    if settings.compensation_height <= 0:
        return 0
    return max(1, round(settings.compensation_height / settings.layer_height))


def on_compensation(
    sections: list[Section], settings: PlanSettings, remarks: list[str]
) -> list[Section]:
    """The part on layers of its own lowest section, which settle the process and the mixture with the substrate.

    S3 section 4.2: 10 to 15 mm, to be cut off. remarks: for a person.
    """
    count, height = compensation_layers(settings), settings.compensation_height
    if not count:
        return sections
    lowest = sections[0].polygons
    area = merged(lowest).area
    remarks.append(
        f'compensation layer: {height * 1e3:.1f} mm in {count} layers below the part, '
        f'{area * height * 1e6:.1f} cm3, to be cut off'
    )
    below = [Section(i + 1, i * height / count, height / count, lowest) for i in range(count)]
    above = [replace(s, number=s.number + count, z=s.z + height) for s in sections]
    return [*below, *above]
