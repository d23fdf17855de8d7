"""Where the files of a restoration lie: one way for planner, laboratory, job and panel.

The nominal part decides. Its lower corner is the work zero (with a program, the place that its path says), and the worn
part comes along: both files are in the same coordinates and units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from waam_plan import masks
from waam_plan.agreement import check
from waam_plan.mesh.inputs import Surfaces, of_part
from waam_plan.mesh.part import Part, PartError, load_part
from waam_plan.mesh.surface import behind, top_surface
from waam_plan.settings import PlanSettings, Triple
from waam_process.grid import GridSpec, HeightGrid

TABLE_CELL, TABLE_MARGIN = 0.4e-3, 15e-3  # m, of a simulated cell as it is shipped
HOLE = 4e-6  # m2, smaller places without a face are seams of the mesh


@dataclass(frozen=True)
class Table:
    """What lies in a simulated cell: heights over its table (m), finite everywhere, work frame."""

    heights: HeightGrid
    notes: tuple[str, ...] = ()  # what of the scan was left out or assumed, for a person


def surfaces_of(
    part: Part, worn: Path, scale: float, settings: PlanSettings, zone: bool = False
) -> Surfaces:
    """`of_part`, checked. PlanError where the two do not lie on each other, PartError for a part open above."""
    surfaces = of_part(part, worn, scale, settings, zone)
    tilted = part.tilted(settings.tilt_deg)
    check_whole(tilted, surfaces.nominal.spec, surfaces.offset)
    check(surfaces.found, surfaces.nominal, settings, bottom=0.0)
    return surfaces


def check_whole(part: Part, spec: GridSpec, offset: Triple) -> None:
    """PartError where faces are missing in the top of a nominal part: nobody knows what is wanted there."""
    open_above = behind(part.mesh, spec, offset)
    if open_above.sum() * spec.resolution**2 > HOLE:
        raise PartError(
            f'{part.path}: the part is open above, faces are missing: {masks.largest(open_above, spec)}; close it '
            '(--repair) or export it again'
        )


def on_table(
    part: Part | None,
    worn: Path,
    scale: float,
    settings: PlanSettings,
    cell: float = TABLE_CELL,
    margin: float = TABLE_MARGIN,
    offset: Triple | None = None,
) -> Table:
    """The worn part as it lies in a simulated cell, on cells of `cell` with `margin` (m) of bare table around it.

    part: the nominal one as in its file, None = there is none, and the worn mesh is in the work frame. settings: those
    that it is planned with. offset: of a nominal part that a program places. Where the file does not show the part, it
    is as beside it, as the planner takes it to be. PlanError, PartError or ValueError with a text for the user.
    """
    rim = float(np.ceil(margin / cell)) * cell
    if part is None:
        mesh = load_part(worn, scale, require_closed=False).mesh
        (x0, y0, _), (x1, y1, _) = mesh.bounds
        spec = GridSpec.covering(x0 - rim, y0 - rim, x1 + rim, y1 + rim, cell)
        return _standing(top_surface(mesh, spec), np.zeros(spec.shape, bool))
    surfaces = surfaces_of(part, worn, scale, replace(settings, grid=cell, margin=rim))
    lies = _standing(surfaces.found, np.isfinite(surfaces.nominal.z))
    table = replace(lies, notes=(*getattr(surfaces, 'notes', ()), *lies.notes))
    if offset is None:
        return table
    x, y, z = np.subtract(offset, surfaces.offset)
    spec = replace(
        table.heights.spec,
        origin_x=table.heights.spec.origin_x + float(x),
        origin_y=table.heights.spec.origin_y + float(y),
    )
    return replace(table, heights=HeightGrid(spec, np.maximum(table.heights.z + z, 0.0)))


def _standing(found: HeightGrid, on_part: np.ndarray) -> Table:
    """Nothing lies under the table, and bare table where nothing was seen beside the part."""
    unseen = on_part & ~np.isfinite(found.z)
    z = np.where(on_part, masks.fill_unknown(found.z), np.nan_to_num(found.z, nan=0.0))
    notes: tuple[str, ...] = ()
    if unseen.any():
        place = masks.largest(unseen, found.spec)
        notes = (f'not seen, filled from neighbours: {place}',)
    return Table(found.with_z(np.maximum(z, 0.0)), notes)
