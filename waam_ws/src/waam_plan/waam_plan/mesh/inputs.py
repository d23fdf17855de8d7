"""From files to the two surfaces of a restoration: as found, and nominal."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waam_plan import masks
from waam_plan.mesh.clouds import Cloud, cloud_grid, is_cloud, read_cloud, spec_around
from waam_plan.mesh.part import Part, PartError, load_part
from waam_plan.mesh.surface import top_surface
from waam_plan.mesh.units import wrong_ratio
from waam_plan.settings import PlanSettings, Triple
from waam_process.grid import GridSpec, HeightGrid
from waam_robot.tilt import tilted

HIGHEST = 99.5  # percentile of a cloud that counts as its top, single splashes apart


@dataclass(frozen=True)
class Surfaces:
    """As found and nominal on one grid, work frame; offset: what was added to the files' coordinates, m.

    notes: what of the scan was left out or assumed, for a person.
    """

    found: HeightGrid
    nominal: HeightGrid
    offset: Triple
    notes: tuple[str, ...] = ()


def of_part(part: Part, worn: Path, scale: float, settings: PlanSettings, zone: bool) -> Surfaces:
    """Nominal from a mesh; worn: mesh, cloud or .npz height grid (that one already in the work frame).

    zone: the scan shows the worn zone only, nothing is planned beside it. Both are tilted by settings.tilt_deg.
    """
    corner, tilt = part.bounds[0].copy(), settings.tilt_deg
    part = part.tilted(tilt)
    offset = _negated(part.bounds[0])
    notes: list[str] = []
    if worn.suffix.lower() == '.npz' and not is_cloud(worn):
        found = load_map(worn)
    else:
        size = part.bounds[1] - part.bounds[0]
        m = settings.margin
        spec = GridSpec.covering(-m, -m, size[0] + m, size[1] + m, settings.grid)
        found, notes = _on(spec, worn, scale, offset, corner, tilt, None if zone else size)
    nominal = top_surface(part.mesh, found.spec, offset)
    wanted = within(nominal, found, settings) if zone else nominal
    return Surfaces(found, wanted, offset, tuple(notes))


def load_map(path: Path) -> HeightGrid:
    """A height map (.npz, m, work frame). PartError where it is none."""
    try:
        return HeightGrid.load_npz(path)
    except FileNotFoundError:
        raise PartError(f'{path}: no such file') from None
    except Exception as e:  # numpy and zipfile raise whatever their parsers raise
        raise PartError(f'{path}: not a height map ({e})') from None


def _negated(point: np.ndarray) -> Triple:
    x, y, z = point
    return -float(x), -float(y), -float(z)


def _on(
    spec: GridSpec,
    worn: Path,
    scale: float,
    offset: Triple,
    corner: np.ndarray,
    tilt: float,
    size: np.ndarray | None,
) -> tuple[HeightGrid, list[str]]:
    """corner: (3,) m, of the part, about which both are tilted by `tilt` degrees. size: (3,) m, of the part that the
    scan shows wholly, None where it shows a zone of it."""
    if is_cloud(worn):
        cloud = read_cloud(worn, scale)
        points, notes = cloud.points, cloud.notes
        if tilt:
            points = tilted(points - corner, np.radians(tilt))
        low, high = points.min(axis=0), points.max(axis=0)
        found = cloud_grid(points + offset, spec)
        beside = ~spec.contains(points[:, 0] + offset[0], points[:, 1] + offset[1])
        if beside.any():
            notes.append(f'{worn.name}: {int(beside.sum())} points beside the part are not used')
    else:
        part = load_part(worn, scale, require_closed=False)
        notes = [f'{worn.name}: {text}' for text in part.report.notes]
        mesh = part.tilted(tilt, corner).mesh
        low, high = mesh.bounds
        found = top_surface(mesh, spec, offset)
    if size is not None and (wrong := wrong_ratio((high - low)[:2], size[:2], worn)):
        raise PartError(wrong)
    return found, notes


def within(nominal: HeightGrid, found: HeightGrid, settings: PlanSettings) -> HeightGrid:
    """The nominal surface where the scan saw something, its small gaps closed."""
    seen = np.isfinite(found.z)
    seen = masks.close_gaps(seen, settings.bead_width / 2 / found.spec.resolution)
    return nominal.with_z(np.where(seen, nominal.z, np.nan))


def flat(cloud: Cloud, settings: PlanSettings, level: float | None = None) -> Surfaces:
    """A scanned zone that is to become flat, without a part, moved so that its lower corner is the work zero.

    The height of the corner is that of the lowest cell whose neighbours lie there, too: a single point is none.
    level: wanted height in the coordinates of the points, m; default: their top plus one layer, so that metal is
    laid everywhere. settings.allowance comes on top of it.
    """
    points = cloud.points
    top = float(np.percentile(points[:, 2], HIGHEST))
    wanted = top + settings.layer_height if level is None else level
    x, y = (-float(v) for v in points[:, :2].min(axis=0))
    moved = points + (x, y, 0.0)
    grid = cloud_grid(moved, spec_around(moved, settings.margin, settings.grid))
    lowest = float(np.nanmin(grid.z))
    found = grid.with_z(grid.z - lowest)
    nominal = HeightGrid.full(found.spec, wanted - lowest)
    zone = within(nominal, found, settings)
    return Surfaces(found, zone, (x, y, -lowest), tuple(cloud.notes))
