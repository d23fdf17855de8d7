"""What the maps of a job say: area laid on, metal that grew, and how much of it was wanted."""

from __future__ import annotations

import numpy as np

from .content import Row, Surface
from .values import ratio


def restored(surfaces: list[Surface]) -> Row:
    """area_mm2, grown_mm3, wanted_mm3 of table jobs, from the first and the last scan; nothing without two of them.

    Grown: volume between both scans. Wanted: of it, what lies in the region and below the nominal surface. Grid cells
    that one scan did not see count as the mean of the others in the region.
    """
    usable = [s for s in surfaces if 'z' in s.arrays and 'nominal' in s.arrays]
    if len(usable) < 2 or usable[0].arrays['z'].shape != usable[-1].arrays['z'].shape:
        return {}
    first, last = usable[0], usable[-1]
    z0, z1, nominal = (
        np.asarray(a, float) for a in (first.arrays['z'], last.arrays['z'], last.arrays['nominal'])
    )
    region = last.arrays.get('region', np.isfinite(nominal)).astype(bool) & np.isfinite(nominal)
    seen = np.isfinite(z0) & np.isfinite(z1)
    if not (region & seen).any():
        return {}
    cell = last.resolution**2 * 1e9  # mm3 per m of height
    unseen = np.count_nonzero(region & ~seen)
    inside = (z1 - z0)[region & seen]
    grown = (z1 - z0)[seen].sum() + unseen * inside.mean()
    useful = np.clip(np.minimum(z1, nominal) - z0, 0, None)[region & seen]
    return {
        'area_mm2': float(np.count_nonzero(region) * last.resolution**2 * 1e6),
        'grown_mm3': float(grown * cell),
        'wanted_mm3': float((useful.sum() + unseen * useful.mean()) * cell),
    }


def add_surfaces(job: Row, surfaces: list[Surface], wire_area: float | None) -> None:
    """Completes the row of a job. wire_area: cross-section of the wire in m2."""
    found = restored(surfaces)
    job.update(found)
    fed = job.get('wire_m')
    volume = fed * wire_area * 1e9 if fed is not None and wire_area else None
    job['efficiency'] = ratio(found.get('grown_mm3'), volume)
    job['material_use'] = ratio(found.get('wanted_mm3'), volume)


def add_counts(job: Row, beads: list[Row]) -> None:
    """Completes the row of a job with the number of its beads, and its strikes over them."""
    job['beads'] = len(beads) or None
    strikes = job.get('strikes')
    if strikes is None and beads:
        strikes = job['strikes'] = sum(b['strikes'] for b in beads)
    job['strikes_per_bead'] = ratio(strikes, job['beads'])
