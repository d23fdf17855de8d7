"""From files to the two surfaces of a restoration: as found, and nominal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waam_plan import masks
from waam_plan.mesh.clouds import cloud_grid, is_cloud, read_cloud, spec_around
from waam_plan.mesh.part import Part, load_part
from waam_plan.mesh.surface import top_surface
from waam_plan.settings import PlanSettings, Triple
from waam_process.grid import GridSpec, HeightGrid
from waam_robot.tilt import tilted

HIGHEST = 99.5  # percentile of a cloud that counts as its top, single splashes apart


@dataclass(frozen=True)
class Surfaces:
    """As found and nominal on one grid, work frame; offset: what was added to the files' coordinates, m."""

    found: HeightGrid
    nominal: HeightGrid
    offset: Triple


def of_part(part: Part, worn: Path, scale: float, settings: PlanSettings, zone: bool) -> Surfaces:
    """Nominal from a mesh; worn: mesh, cloud or .npz height grid (that one already in the work frame).

    zone: the scan shows the worn zone only, nothing is planned beside it. Both are tilted by settings.tilt_deg.
    """
    corner, tilt = part.bounds[0].copy(), settings.tilt_deg
    part = part.tilted(tilt)
    offset = _negated(part.bounds[0])
    if worn.suffix.lower() == '.npz':
        found = HeightGrid.load_npz(worn)
    else:
        size = part.bounds[1] - part.bounds[0]
        m = settings.margin
        spec = GridSpec.covering(-m, -m, size[0] + m, size[1] + m, settings.grid)
        found = _on(spec, worn, scale, offset, corner, tilt)
    nominal = top_surface(part.mesh, found.spec, offset)
    return Surfaces(found, within(nominal, found, settings) if zone else nominal, offset)


def _negated(point: np.ndarray) -> Triple:
    x, y, z = point
    return -float(x), -float(y), -float(z)


def _on(
    spec: GridSpec, worn: Path, scale: float, offset: Triple, corner: np.ndarray, tilt: float
) -> HeightGrid:
    """corner: (3,) m, of the part, about which both are tilted by `tilt` degrees."""
    if is_cloud(worn):
        points = read_cloud(worn, scale)
        if tilt:
            points = tilted(points - corner, np.radians(tilt))
        return cloud_grid(points + offset, spec)
    mesh = load_part(worn, scale, require_closed=False).tilted(tilt, corner).mesh
    return top_surface(mesh, spec, offset)


def within(nominal: HeightGrid, found: HeightGrid, settings: PlanSettings) -> HeightGrid:
    """The nominal surface where the scan saw something, its small gaps closed."""
    seen = np.isfinite(found.z)
    seen = masks.close_gaps(seen, settings.bead_width / 2 / found.spec.resolution)
    return nominal.with_z(np.where(seen, nominal.z, np.nan))


def flat(points: np.ndarray, settings: PlanSettings, level: float | None = None) -> Surfaces:
    """A scanned zone that is to become flat, without a part: (n, 3) m, moved so that its lower corner is the work zero.

    level: wanted height in the coordinates of the points, m; default: their top plus one layer, so that metal is
    laid everywhere. settings.allowance comes on top of it.
    """
    top = float(np.percentile(points[:, 2], HIGHEST))
    wanted = top + settings.layer_height if level is None else level
    offset = _negated(points.min(axis=0))
    moved = points + offset
    found = cloud_grid(moved, spec_around(moved, settings.margin, settings.grid))
    nominal = HeightGrid.full(found.spec, wanted + offset[2])
    return Surfaces(found, within(nominal, found, settings), offset)
